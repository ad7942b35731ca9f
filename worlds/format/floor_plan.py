# SPDX-License-Identifier: MIT
"""Worlds from floor plans: an occupancy raster or a ROS map_server map becomes walls along the edges of its cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from scipy import ndimage
from shapely.geometry import Polygon

from worlds.elements import Position, Wall
from worlds.errors import WorldError
from worlds.file_names import to_name
from worlds.raster import MAX_CELLS
from worlds.world import Start, World

_MAX_YAML_BYTES = 100_000


class _MapFile(BaseModel):
    """The YAML part of a map_server map (ROS 2 nav2_map_server; other keys are allowed and ignored)."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    image: str = Field(min_length=1)
    resolution: float = Field(gt=0.0, le=100.0, allow_inf_nan=False)
    origin: tuple[float, float, float]
    negate: int = Field(0, ge=0, le=1)
    occupied_thresh: float = Field(0.65, ge=0.0, le=1.0)


def world_from_grid(
    occupied: NDArray[np.bool_],
    resolution: float,
    *,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    start: tuple[float, float, float] | None = None,
    name: str = "floor plan",
) -> World:
    """A world whose walls are the occupied cells (rows, cols); row 0 has the lowest y.

    resolution: side of a cell [m]; origin: pose of the outer corner of cell (0, 0) [m, m, rad]; start: pose of the
    robot in the world, by default the place farthest from all walls. A wall of one cell is put about the plan, so that
    its outline is closed. The world has no tour. Raises `WorldError` if the plan is too large or has no free cell.
    """
    if occupied.ndim != 2 or occupied.size == 0:
        raise WorldError(f"floor plan of shape {occupied.shape}, expected rows and columns")
    if occupied.size > MAX_CELLS:
        raise WorldError(f"floor plan of {occupied.size} cells, expected at most {MAX_CELLS}")
    if occupied.all():
        raise WorldError("floor plan without a free cell, expected free space")
    framed = np.pad(occupied, 1, constant_values=True)
    in_frame = start if start is not None else _roomiest_place(framed, resolution, origin)
    try:
        return World(
            name=name,
            description=f"Imported floor plan of {occupied.shape[0]} x {occupied.shape[1]} cells at {resolution:g} m",
            start=Start(x=in_frame[0], y=in_frame[1], theta=in_frame[2]),
            walls=[
                Wall(name=f"edge {k + 1}", points=_placed(loop - 1.0, resolution, origin), closed=True)
                for k, loop in enumerate(edge_loops(framed))
            ],
        )
    except ValidationError as error:  # too many edges, or too far from the origin
        raise WorldError(f"floor plan {name!r}: {error.errors(include_url=False)[0]['msg']}") from None


def edge_loops(occupied: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Corners (n, 2) `(x, y)` in cells of the closed lines between occupied and free cells, with straight runs joined.

    Cells beyond the border count as occupied.
    """
    padded = np.pad(~occupied, 1)
    across = padded[:, 1:] != padded[:, :-1]  # upright edges, between columns
    up = padded[1:] != padded[:-1]  # level edges, between rows
    runs = [*_runs(across.T, upright=True), *_runs(up, upright=False)]
    if not runs:
        return []
    polygons = shapely.get_parts(shapely.polygonize([shapely.node(shapely.multilinestrings(runs))]))
    free = [part for part in polygons if _is_free(part, ~padded[1:-1, 1:-1])]
    rings = [ring for part in free for ring in (part.exterior, *part.interiors)]
    return [shapely.get_coordinates(ring)[:-1] for ring in shapely.simplify(rings, 0.0)]


def _runs(edges: NDArray[np.bool_], *, upright: bool) -> list[list[Position]]:
    """Straight runs of cell edges as lines, in cells; each row of `edges` is one grid line."""
    ends = np.diff(np.pad(edges.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    lines, begin = np.nonzero(ends == 1)
    end = np.nonzero(ends == -1)[1]
    low, high, at = begin - 1.0, end - 1.0, lines * 1.0  # the padding shifts all by one cell
    if upright:
        return [[(x, y0), (x, y1)] for x, y0, y1 in zip(at, low, high, strict=True)]
    return [[(x0, y), (x1, y)] for y, x0, x1 in zip(at, low, high, strict=True)]


def _is_free(part: Polygon, occupied: NDArray[np.bool_]) -> bool:
    """Is the polygon, whose edges all lie between free and occupied cells, made of free cells?"""
    (x0, y0), (x1, y1) = shapely.get_coordinates(part.exterior)[:2]
    normal = np.array([y0 - y1, x1 - x0]) / np.hypot(x1 - x0, y1 - y0)
    inward = 0.5 if part.exterior.is_ccw else -0.5
    step = np.array([x1 - x0, y1 - y0]) / np.hypot(x1 - x0, y1 - y0)
    col, row = np.floor(np.array([x0, y0]) + 0.5 * step + inward * normal).astype(int)
    return not occupied[row, col]


def _placed(corners: NDArray[np.float64], resolution: float, origin: tuple[float, float, float]) -> list[Position]:
    """Corners in cells as points of the world [m]."""
    cos, sin = np.cos(origin[2]), np.sin(origin[2])
    x, y = resolution * corners.T
    placed = np.stack([origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y], axis=-1).round(6)
    return [(float(px), float(py)) for px, py in placed]


def _roomiest_place(
    framed: NDArray[np.bool_], resolution: float, origin: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Middle of the free cell that is farthest from all occupied ones."""
    distance = ndimage.distance_transform_edt(~framed)
    row, col = np.unravel_index(int(np.argmax(distance)), framed.shape)
    (place,) = _placed(np.array([[col - 0.5, row - 0.5]]), resolution, origin)
    return place[0], place[1], 0.0


def import_map(path: str | Path, *, start: tuple[float, float, float] | None = None) -> World:
    """The world of a ROS map_server map: a YAML file that names a PGM image beside it.

    Cells above `occupied_thresh` are walls; unknown cells are free if they can be reached, as map_server has no walls
    there. Raises `WorldError` if a file is missing, damaged or too large, or the image lies outside of the folder.
    """
    path = Path(path)
    description = _read_yaml(path)
    grey = read_pgm(_image_beside(path, description))
    share = grey if description.negate else 1.0 - grey
    occupied = np.flipud(share > description.occupied_thresh)  # images begin at the top
    return world_from_grid(
        occupied, description.resolution, origin=description.origin, start=start, name=to_name(path.stem)
    )


def is_map(path: str | Path) -> bool:
    """Whether a file is meant to be a map_server map, by its name."""
    return Path(path).suffix in {".yaml", ".yml"}


def map_image(path: str | Path) -> Path:
    """The image that a map_server map names. Raises `WorldError` as `import_map` does."""
    return _image_beside(Path(path), _read_yaml(Path(path)))


def _image_beside(path: Path, description: _MapFile) -> Path:
    image = (path.parent / description.image).resolve()
    if not image.is_relative_to(path.parent.resolve()):
        raise WorldError(f"{path}: image {description.image!r} lies outside of the map's folder, expected a file in it")
    return image


def _read_yaml(path: Path) -> _MapFile:
    try:
        if path.stat().st_size > _MAX_YAML_BYTES:
            raise WorldError(f"{path}: more than {_MAX_YAML_BYTES} bytes, expected a map_server map")
        text = path.read_text(encoding="utf-8")
        if "&" in text:
            raise WorldError(f"{path}: YAML anchors are not allowed, expected a map_server map")
        table: Any = yaml.safe_load(text)
        return _MapFile.model_validate(table)
    except OSError as error:
        raise WorldError(f"{path}: {error.strerror}, expected a map_server map") from None
    except (UnicodeDecodeError, yaml.YAMLError, RecursionError, ValueError) as error:
        if isinstance(error, WorldError):
            raise
        if isinstance(error, ValidationError):
            problem = error.errors(include_url=False)[0]
            key = ".".join(str(part) for part in problem["loc"])
            what = f"{key}: {problem['msg']}" if key else "no keys and values"
            raise WorldError(f"{path}: {what}, expected a map_server map") from None
        raise WorldError(f"{path}: not readable as YAML, expected a map_server map") from None


def read_pgm(path: Path) -> NDArray[np.float64]:
    """Grey values in [0, 1], (rows, cols), top row first, of a PGM image (binary P5 or text P2).

    Raises `WorldError` for anything else, and above `MAX_CELLS` pixels before any memory is taken.
    """
    try:
        with path.open("rb") as file:
            head = file.read(4096)
            fields, begin = _pgm_header(head, path)
            kind, width, height, top = fields
            if width * height > MAX_CELLS:
                raise WorldError(f"{path}: {width} x {height} pixels, expected at most {MAX_CELLS}")
            file.seek(begin)
            body = file.read(width * height * 2 + 1 if kind == "P5" else width * height * 7 + 1000)
    except OSError as error:
        raise WorldError(f"{path}: {error.strerror}, expected a PGM image") from None
    try:
        if kind == "P5":
            pixels = np.frombuffer(body, dtype=np.uint8 if top < 256 else ">u2", count=width * height)
        else:
            pixels = np.array(body.split()[: width * height], dtype=np.uint16)
        return pixels.reshape(height, width) / float(top)
    except ValueError:
        raise WorldError(f"{path}: image data is cut off or damaged, expected {width} x {height} pixels") from None


def _pgm_header(head: bytes, path: Path) -> tuple[tuple[str, int, int, int], int]:
    """Kind, width, height and largest value of a PGM file, and where its pixels begin."""
    tokens: list[bytes] = []
    at = 0
    while len(tokens) < 4 and at < len(head):
        if head[at : at + 1].isspace():
            at += 1
        elif head[at : at + 1] == b"#":
            at = head.find(b"\n", at) if b"\n" in head[at:] else len(head)
        else:
            end = next((k for k in range(at, len(head)) if head[k : k + 1].isspace()), len(head))
            tokens.append(head[at:end])
            at = end
    if len(tokens) < 4 or tokens[0] not in {b"P2", b"P5"} or not all(t.isdigit() for t in tokens[1:]):
        raise WorldError(f"{path}: not a PGM image, expected P5 or P2 with width, height and largest value")
    width, height, top = (int(token) for token in tokens[1:])
    if not (width > 0 and height > 0 and 0 < top < 65536):
        raise WorldError(f"{path}: PGM of {width} x {height} pixels up to {top}, expected positive sizes")
    return (tokens[0].decode(), width, height, top), at + 1
