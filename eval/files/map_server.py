# SPDX-License-Identifier: MIT
"""Maps as ROS map_server keeps them: a grey picture (`.pgm`) and a `.yaml` that says what its pixels mean.

`worlds.format.map_file` reads them. The maps written here are right for every map_server (mode `trinary`), and keep the
probabilities as well: a pixel is `round(255 (1 - P))`, a cell that was never seen is 128, and the extra key
`unknown_pixel: 128`, which map_server ignores, tells the reader so. Read back, a probability is within 1/255 of what it
was.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from eval.files.atomic_write import atomic_write
from slam.occupancy import OccupancyGrid
from worlds.errors import MapFileError
from worlds.format.map_file import MAX_PIXELS, MapFile, read_map_file

UNKNOWN_PIXEL = 128
"""Grey of a cell never seen; map_server's trinary mode reads it as unknown too."""


def write_map(path: str | os.PathLike[str], grid: OccupancyGrid) -> None:
    """Write `path` (`….yaml`) and the picture of the same name (`….pgm`).

    Raises MapFileError where `path` does not end in .yaml or the map has more than `MAX_PIXELS` cells.
    """
    path = Path(path)
    if path.suffix not in {".yaml", ".yml"}:
        raise MapFileError(f"{path}: expected a name that ends in .yaml")
    rows, cols = grid.probability.shape
    if not 0 < rows * cols <= MAX_PIXELS:
        raise MapFileError(f"{path}: a map of {cols} x {rows} cells, expected 1 to {MAX_PIXELS:,} cells")
    pixels = np.full((rows, cols), UNKNOWN_PIXEL, dtype=np.uint8)
    exact = 255.0 * (1.0 - grid.probability[grid.known].astype(np.float64))
    nearer = np.where(exact > UNKNOWN_PIXEL, UNKNOWN_PIXEL + 1, UNKNOWN_PIXEL - 1)
    shade = np.rint(exact)
    pixels[grid.known] = np.where(shade == UNKNOWN_PIXEL, nearer, shade)
    image = path.with_suffix(".pgm")
    document = {
        "image": image.name,
        "mode": "trinary",
        "resolution": float(grid.resolution),
        "origin": [float(value) for value in grid.origin],
        "negate": 0,
        "occupied_thresh": OccupancyGrid.OCCUPIED,
        "free_thresh": OccupancyGrid.FREE,
        "unknown_pixel": UNKNOWN_PIXEL,
    }
    # left from the inside out: the picture is there first, then the YAML that names it
    with atomic_write(path) as text, atomic_write(image) as picture:
        Image.fromarray(np.flipud(pixels)).save(picture, format="PPM")
        text.write_text(yaml.safe_dump(document, sort_keys=False, default_flow_style=None), encoding="utf-8")


def read_map(path: str | os.PathLike[str], *, max_pixels: int = MAX_PIXELS, inside: bool = False) -> OccupancyGrid:
    """Read a map as `worlds.format.map_file.read_map_file` does, without its notes."""
    return grid_from_map_file(read_map_file(Path(path), max_pixels=max_pixels, inside=inside))


def grid_from_map_file(file: MapFile) -> OccupancyGrid:
    """Convert a map that was read from its files to an occupancy grid."""
    return OccupancyGrid(probability=file.probability, resolution=file.resolution, origin=file.origin)
