# SPDX-License-Identifier: MIT
"""Read maps as ROS map_server keeps them: a picture, and a `.yaml` that says what its pixels mean.

Sources: http://wiki.ros.org/map_server (format, trinary / scale / raw) and nav2_map_server's map_io.cpp. White is
free, black is occupied; the picture's first row is the map's highest y, so rows are turned over on the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from worlds.errors import MAX_QUOTED, MapFileError, shown
from worlds.format.greys import Thresholds, probabilities
from worlds.format.pixels import read_pixels
from worlds.regular_file import refuse_devices

MAX_PIXELS = 100_000_000
"""Largest picture: 100 megapixels are 400 MB as probabilities, 500 m x 500 m at 5 cm."""
MAX_RESOLUTION = 100.0
"""Largest side of a cell [m]; larger numbers are not metres."""
_MAX_YAML_BYTES = 1_000_000
_MAX_USUAL_CELL = 0.5
"""Larger cells add a note [m]: their side may not be in metres."""
_MODES = ("trinary", "scale", "raw")


@dataclass(frozen=True, eq=False)
class MapFile:
    """A map, read from its files."""

    probability: NDArray[np.float32]
    """P(occupied), (rows, cols), NaN = unknown; row 0 has the lowest y."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float, float]
    """Pose `(x, y, yaw)` [m, m, rad] of the outer corner of cell (0, 0) in the map's frame."""
    notes: tuple[str, ...]
    """What a reader of the map must know, each a sentence that names the file."""


def is_map(path: str | Path) -> bool:
    """Return whether a file is meant to be a map_server map, by its name."""
    return Path(path).suffix in {".yaml", ".yml"}


def map_image(path: str | Path, *, inside: bool = False) -> Path:
    """Return the picture that a map names. Raises MapFileError as `read_map_file` does."""
    return _image(Path(path), _read_document(Path(path)), inside)[0]


def read_map_file(path: str | Path, *, max_pixels: int = MAX_PIXELS, inside: bool = False) -> MapFile:
    """Read a map from its `.yaml`.

    `trinary`: cells become 1 above `occupied_thresh`, 0 below `free_thresh`, NaN between. `scale`: between the
    thresholds the probability is kept. `raw`: pixels of 0 to 100 are percent, others unknown. Transparent pixels are
    unknown. With the key `unknown_pixel`, which `eval.files.map_server.write_map` writes, all other pixels are
    probabilities. A picture that does not exist is looked for under its name in the map's own directory, in capitals or
    not. Greys that a program writes for unknown cells mean it, whatever the thresholds say (`worlds.format.greys`).

    inside: refuse pictures outside of the map's directory, for files from elsewhere
    Raises MapFileError for keys that are missing or make no sense, and for a picture that is missing, damaged, outside,
    or larger than `max_pixels`.
    """
    path = Path(path)
    document = _read_document(path)
    resolution = _number(path, document, "resolution")
    if not 0.0 < resolution <= MAX_RESOLUTION:
        raise MapFileError(
            f"{path}: resolution: expected metres per pixel above 0 and up to {MAX_RESOLUTION:g}, got {resolution:g}"
        )
    origin = _origin(path, document)
    mode = str(document.get("mode") or "trinary").lower()
    if mode not in _MODES:
        raise MapFileError(f"{path}: mode: expected one of {', '.join(_MODES)}, got {shown(document['mode'])}")
    image, note = _image(path, document, inside)
    notes = [note] if note else []
    pixels = read_pixels(image, max_pixels=max_pixels)
    found, odd = probabilities(pixels, _thresholds(path, document, mode))
    notes += [f"{path}: {note}" for note in odd]
    if resolution > _MAX_USUAL_CELL:
        notes.append(f"{path}: resolution: cells of {resolution:g} m, is this in metres?")
    if abs(origin[2]) > math.pi + 0.01:
        notes.append(
            f"{path}: origin: a yaw of {origin[2]:g} turns the map by {math.degrees(origin[2]):.0f} degrees, is this "
            "in radians?"
        )
    return MapFile(np.flipud(found).copy(), resolution, origin, tuple(notes))


def _read_document(path: Path) -> dict[str, Any]:
    expected = "expected a map_server .yaml file with image, resolution and origin"
    try:
        refuse_devices(path)
        if path.stat().st_size > _MAX_YAML_BYTES:
            raise MapFileError(f"{path}: {path.stat().st_size} bytes, {expected}")
        documents = [part for part in yaml.load_all(path.read_text(encoding="utf-8"), _PlainLoader) if part is not None]
    except OSError as error:
        raise MapFileError(f"{path}: {error.strerror}, {expected}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        if isinstance(error, MapFileError):
            raise
        raise MapFileError(
            f"{path}: not readable as YAML ({' '.join(str(error).split())[:MAX_QUOTED]}), {expected}"
        ) from None
    if len(documents) != 1 or not isinstance(documents[0], dict):
        what = f"{len(documents)} documents" if len(documents) > 1 else "no keys and values"
        raise MapFileError(f"{path}: {what}, {expected}")
    document: dict[str, Any] = documents[0]
    if missing := [key for key in ("image", "resolution", "origin") if key not in document]:
        there = ", ".join(map(str, list(document)[:8]))[:MAX_QUOTED]
        message = "; a message that was printed is no map file: save it with map_saver" if "info" in document else ""
        raise MapFileError(f"{path}: {missing[0]}: missing, {expected}; there is: {there}{message}")
    return document


def _number(path: Path, document: dict[str, Any], key: str, default: float | None = None) -> float:
    return _finite(path, key, document.get(key, default))


def _finite(path: Path, key: str, value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise MapFileError(f"{path}: {key}: expected a number, got {shown(value)}")
    return number


def _origin(path: Path, document: dict[str, Any]) -> tuple[float, float, float]:
    value = document.get("origin")
    if not (isinstance(value, list) and len(value) in (2, 3)):
        raise MapFileError(f"{path}: origin: expected [x, y, yaw] in metres and radians, got {shown(value)}")
    x, y, yaw = (_finite(path, "origin", item) for item in [*value, 0.0][:3])
    if abs(yaw) > 2.0 * math.pi:
        raise MapFileError(f"{path}: origin: expected a yaw in radians, got {yaw:g}, which looks like degrees")
    return x, y, yaw


def _image(path: Path, document: dict[str, Any], inside: bool) -> tuple[Path, str | None]:
    """Return the picture of a map, and a note where it was found elsewhere than the map says."""
    name = document.get("image")
    if not (isinstance(name, str) and name):
        raise MapFileError(f"{path}: image: expected the name of a picture, got {shown(name)}")
    image, local = path.parent / name, _in_any_case(path.parent / PureWindowsPath(name).name)
    outside = not image.resolve().is_relative_to(path.parent.resolve())
    if image.is_file() and not (inside and outside):
        return image, None
    if local.is_file() and local.resolve().is_relative_to(path.parent.resolve()):
        return local, f"{path}: image: {name} does not exist here, {local} is read instead"
    if inside and outside:
        raise MapFileError(f"{path}: image: {name} lies outside of the map's folder, expected a file in it")
    raise MapFileError(f"{path}: image: {name} does not exist, nor does {local}, expected the picture of the map")


def _in_any_case(file: Path) -> Path:
    """Return the file, or the only one beside it whose name differs in capitals alone."""
    if file.is_file() or not file.parent.is_dir():
        return file
    alike = [other for other in file.parent.iterdir() if other.name.lower() == file.name.lower()]
    return alike[0] if len(alike) == 1 else file


def _thresholds(path: Path, document: dict[str, Any], mode: str) -> Thresholds:
    """Return the rules by which a map's greys are read."""
    negate = document.get("negate", 0)
    if str(negate).lower() not in ("0", "1", "false", "true"):
        raise MapFileError(f"{path}: negate: expected 0 or 1, got {shown(negate)}")
    occupied = _number(path, document, "occupied_thresh", 0.65)
    free = _number(path, document, "free_thresh", 0.196)
    if not 0.0 <= free <= occupied <= 1.0:
        raise MapFileError(
            f"{path}: expected 0 <= free_thresh <= occupied_thresh <= 1, got free_thresh {free:g} and "
            f"occupied_thresh {occupied:g}"
        )
    unknown = _number(path, document, "unknown_pixel") if "unknown_pixel" in document else None
    return Thresholds(mode, str(negate).lower() in ("1", "true"), occupied, free, unknown)


class _PlainLoader(yaml.SafeLoader):
    """Reads plain data without aliases, of which a few lines can stand for gigabytes, and with each key once."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Make a mapping; raises ConstructorError where a key stands twice: programs differ in which one counts."""
        found: dict[Any, Any] = super().construct_mapping(node, deep)
        if len(found) < len(node.value):
            keys = [str(key.value) for key, _ in node.value]
            twice = next((key for key in keys if keys.count(key) > 1), keys[0])
            raise yaml.constructor.ConstructorError(None, None, f"the key {twice} stands twice", node.start_mark)
        return found

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Read one value; raises ComposerError at an alias."""
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(None, None, "an alias (*), which a map does not need", mark)
        return super().compose_node(parent, index)
