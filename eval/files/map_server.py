# SPDX-License-Identifier: MIT
"""Maps as ROS map_server keeps them: a grey picture (`.pgm`) and a `.yaml` that says what its pixels mean.

Sources: http://wiki.ros.org/map_server (format, trinary / scale / raw) and nav2_map_server's map_io.cpp. White is
free, black is occupied; the picture's first row is the map's highest y, so rows are turned over on the way.

The maps written here are right for every map_server (mode `trinary`), and keep the probabilities as well: a pixel is
`round(255 (1 - P))`, a cell that was never seen is 128, and the extra key `unknown_pixel: 128`, which map_server does
not read, tells the reader here so. Read back, a probability is within 1/255 of what it was.
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from slam.occupancy import OccupancyGrid

MAX_PIXELS = 100_000_000
"""Larger pictures are refused: 100 megapixels are 400 MB as probabilities, 500 m x 500 m at 5 cm."""
UNKNOWN_PIXEL = 128
"""Grey of a cell never seen; map_server's trinary mode reads it as unknown too."""
_MODES = ("trinary", "scale", "raw")
_HEADER = re.compile(rb"(P[25])" + rb"(?:\s+|\s*#[^\n]*\n)+(\d+)" * 3 + rb"\s")


class MapFileError(ValueError):
    """A map that cannot be read or written; the message names the file, the key and what was expected."""


def write_map(path: str | os.PathLike[str], grid: OccupancyGrid) -> None:
    """Write `path` (`….yaml`) and the picture of the same name beside it (`….pgm`).

    Raises MapFileError where `path` does not end in .yaml or the map is larger than `MAX_PIXELS`.
    """
    path = Path(path)
    if path.suffix not in {".yaml", ".yml"}:
        raise MapFileError(f"{path}: expected a name that ends in .yaml")
    rows, cols = grid.probability.shape
    _check_size(path, rows, cols)
    pixels = np.full((rows, cols), UNKNOWN_PIXEL, dtype=np.uint8)
    exact = 255.0 * (1.0 - grid.probability[grid.known].astype(np.float64))
    beside_unknown = np.where(exact > UNKNOWN_PIXEL, UNKNOWN_PIXEL + 1, UNKNOWN_PIXEL - 1)  # the nearer neighbour
    shade = np.rint(exact)
    pixels[grid.known] = np.where(shade == UNKNOWN_PIXEL, beside_unknown, shade)
    image = path.with_suffix(".pgm")
    with atomic_write(image) as temporary, temporary.open("wb") as file:
        file.write(f"P5\n{cols} {rows}\n255\n".encode())
        file.write(np.flipud(pixels).tobytes())
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
    with atomic_write(path) as temporary:
        temporary.write_text(yaml.safe_dump(document, sort_keys=False, default_flow_style=None), encoding="utf-8")


def read_map(path: str | os.PathLike[str], *, max_pixels: int = MAX_PIXELS) -> OccupancyGrid:
    """Read a map from its `.yaml`.

    `trinary`: cells become 1 above `occupied_thresh`, 0 below `free_thresh`, NaN between. `scale`: between the
    thresholds the probability is kept. `raw`: pixels of 0 to 100 are percent, others unknown. With `unknown_pixel`:
    probabilities as `write_map` writes them.
    Raises MapFileError for keys that are missing or make no sense, a picture that is no PGM, is cut off, or has more
    than `max_pixels`; OSError as `open` does.
    """
    path = Path(path)
    document = _read_document(path)
    resolution = _number(path, document, "resolution")
    if not resolution > 0:
        raise MapFileError(f"{path}: resolution: expected metres per pixel above 0, got {resolution}")
    mode = document.get("mode", "trinary")
    if mode not in _MODES:
        raise MapFileError(f"{path}: mode: expected one of {', '.join(_MODES)}, got {mode!r}")
    if not isinstance(document.get("image"), str):
        raise MapFileError(f"{path}: image: expected the name of a .pgm file, got {document.get('image')!r}")
    origin = _origin(path, document)
    pixels, white = _read_pgm(path.parent / document["image"], max_pixels)
    return OccupancyGrid(
        probability=np.flipud(_probabilities(path, document, mode, pixels, white)).copy(),
        resolution=resolution,
        origin=origin,
    )


def _read_document(path: Path) -> dict[str, Any]:
    if path.stat().st_size > 1_000_000:
        raise MapFileError(f"{path}: expected a small .yaml file beside the picture, got {path.stat().st_size} bytes")
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise MapFileError(f"{path}: expected a map_server .yaml file: {' '.join(str(error).split())}") from None
    if not isinstance(document, dict):
        raise MapFileError(f"{path}: expected a map_server .yaml file with image, resolution and origin")
    return document


def _number(path: Path, document: dict[str, Any], key: str, default: float | None = None) -> float:
    value = document.get(key, default)
    try:
        number = float(value)  # type: ignore[arg-type]  # what cannot be converted is the error below
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise MapFileError(f"{path}: {key}: expected a number, got {value!r}")
    return number


def _origin(path: Path, document: dict[str, Any]) -> tuple[float, float, float]:
    value = document.get("origin")
    if not (isinstance(value, list) and len(value) in (2, 3)):
        raise MapFileError(f"{path}: origin: expected [x, y, yaw] in metres and radians, got {value!r}")
    x, y, yaw = (_number(path, {"origin": item}, "origin") for item in [*value, 0.0][:3])
    if abs(yaw) > 2.0 * math.pi:
        raise MapFileError(f"{path}: origin: expected a yaw in radians, got {yaw} (degrees?)")
    return x, y, yaw


def _probabilities(
    path: Path, document: dict[str, Any], mode: str, pixels: NDArray[np.uint8] | NDArray[np.uint16], white: int
) -> NDArray[np.float32]:
    """P(occupied) of each pixel, (rows, cols), NaN = unknown, by map_server's rules."""
    negate = _number(path, document, "negate", 0.0) != 0.0
    occupied = _number(path, document, "occupied_thresh", 0.65)
    free = _number(path, document, "free_thresh", 0.196)
    if not 0.0 <= free <= occupied <= 1.0:
        raise MapFileError(f"{path}: expected 0 <= free_thresh <= occupied_thresh <= 1, got {free} and {occupied}")
    if mode == "raw":
        percent = pixels.astype(np.float32)
        return np.where(percent <= 100.0, percent / np.float32(100.0), np.float32(np.nan))
    shade = pixels.astype(np.float32) / np.float32(white)
    probability = shade if negate else np.float32(1.0) - shade
    if "unknown_pixel" in document:
        unknown = _number(path, document, "unknown_pixel")
        return np.where(pixels == unknown, np.float32(np.nan), probability)
    between = probability if mode == "scale" else np.full_like(probability, np.nan)
    known = np.where(probability > occupied, np.float32(1.0), between)
    return np.where(probability < free, np.float32(0.0), known)


def _check_size(path: Path, rows: int, cols: int, max_pixels: int = MAX_PIXELS) -> None:
    if rows < 1 or cols < 1:
        raise MapFileError(f"{path}: expected a picture with at least one pixel, got {cols} x {rows}")
    if rows * cols > max_pixels:
        raise MapFileError(f"{path}: {cols} x {rows} pixels are more than the limit of {max_pixels:,} pixels")


def _read_pgm(path: Path, max_pixels: int) -> tuple[NDArray[np.uint8] | NDArray[np.uint16], int]:
    """Grey values (rows, cols) of a binary (P5) or plain (P2) PGM, first row on top, and the value of white."""
    with path.open("rb") as file:
        header = _HEADER.match(file.read(4096))
        if header is None:
            raise MapFileError(f"{path}: expected a PGM picture (P5 or P2) with width, height and white value")
        kind, cols, rows, white = header[1], int(header[2]), int(header[3]), int(header[4])
        _check_size(path, rows, cols, max_pixels)
        if not 0 < white < 65536:
            raise MapFileError(f"{path}: expected a white value of 1 to 65535, got {white}")
        file.seek(header.end())
        if kind == b"P2":
            words = file.read().split()
            values = np.array(words[: rows * cols], dtype=np.uint16)
        else:
            dtype = np.dtype(np.uint8 if white < 256 else ">u2")
            values = np.frombuffer(file.read(rows * cols * dtype.itemsize), dtype=dtype)
    if values.size < rows * cols:
        raise MapFileError(f"{path}: expected {cols} x {rows} pixels, the file ends after {values.size}")
    pixels = values.reshape(rows, cols)
    return (pixels.astype(np.uint8) if white < 256 else pixels.astype(np.uint16)), white
