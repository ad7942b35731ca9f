# SPDX-License-Identifier: MIT
"""A small floor plan, and maps of it as people bring them."""

from pathlib import Path

import numpy as np
import yaml
from PIL import Image

WALL, FREE, UNKNOWN = 0, 254, 205
CELL = 0.05
FLOOR = 44.28
"""Floor of `plan` [m²]."""


def plan(margin: int = 10) -> np.ndarray:
    """Grey values of two rooms of 8 m x 6 m, with a door of 1 m and a table, as map_saver writes them."""
    grid = np.full((120 + 2 * margin, 160 + 2 * margin), UNKNOWN, np.uint8)
    inner = grid[margin:-margin, margin:-margin]
    inner[:] = WALL
    inner[2:-2, 2:-2] = FREE
    inner[:, 80:82] = WALL
    inner[50:70, 80:82] = FREE
    inner[20:32, 110:126] = WALL
    return grid


def p5(grid: np.ndarray, comment: str = "") -> bytes:
    return f"P5\n{comment}{grid.shape[1]} {grid.shape[0]}\n255\n".encode() + grid.astype(np.uint8).tobytes()


def p2(grid: np.ndarray, largest: int = 255) -> bytes:
    rows = "\n".join(" ".join(map(str, row)) for row in grid.tolist())
    return f"P2\n{grid.shape[1]} {grid.shape[0]}\n{largest}\n{rows}\n".encode()


def write(folder: Path, picture: bytes | Image.Image, name: str = "map.pgm", **keys: object) -> Path:
    """Write a picture and its YAML; a key of None is left out."""
    path = folder / name
    picture.save(path) if isinstance(picture, Image.Image) else path.write_bytes(picture)
    document = {"image": name, "resolution": CELL, "origin": [-4.5, -3.5, 0.0], "negate": 0} | keys
    document = {"occupied_thresh": 0.65, "free_thresh": 0.196} | document
    text = yaml.safe_dump({key: value for key, value in document.items() if value is not None})
    (folder / "map.yaml").write_text(text)
    return folder / "map.yaml"
