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
from worlds.format.pixels import Pixels, read_pixels

MAX_PIXELS = 100_000_000
"""Largest picture: 100 megapixels are 400 MB as probabilities, 500 m x 500 m at 5 cm."""
MAX_RESOLUTION = 100.0
"""Largest side of a cell [m]; larger numbers are not metres."""
_MAX_YAML_BYTES = 1_000_000
_MODES = ("trinary", "scale", "raw")
_UNKNOWN_GREYS = (205, 127, 128)
"""Greys with which map_server, its savers and other programs mark unknown cells."""
_MIN_UNKNOWN_SHARE = 0.01
"""Smallest share of all pixels with such a grey that can mean unknown, against the thresholds of the file."""
_ISOLATION = 10
"""Such a grey means unknown if it is this many times as frequent as all greys within 3 of it: probabilities are not."""


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
    probabilities. A picture that does not exist is looked for under its name in the map's own directory. Where one of
    the greys 205, 127 and 128 is a cluster of its own, it means unknown, whatever the thresholds say.

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
    mode = str(document.get("mode", "trinary")).lower()
    if mode not in _MODES:
        raise MapFileError(f"{path}: mode: expected one of {', '.join(_MODES)}, got {shown(document['mode'])}")
    image, note = _image(path, document, inside)
    notes = [note] if note else []
    pixels = read_pixels(image, max_pixels=max_pixels)
    meaning = _meaning(path, document, mode, pixels.white)
    if mode != "raw" and "unknown_pixel" not in document:
        for grey in _unknown_greys(pixels, meaning):
            meaning[grey] = np.nan
            notes.append(
                f"{path}: grey {grey} is read as unknown, as map savers mean it, although free_thresh and "
                "occupied_thresh make it known"
            )
    probability = meaning[pixels.grey]
    if pixels.transparent is not None:
        probability[pixels.transparent] = np.nan
    return MapFile(np.flipud(probability).copy(), resolution, origin, tuple(notes))


def _read_document(path: Path) -> dict[str, Any]:
    expected = "expected a map_server .yaml file with image, resolution and origin"
    try:
        if path.stat().st_size > _MAX_YAML_BYTES:
            raise MapFileError(f"{path}: {path.stat().st_size} bytes, {expected}")
        document = yaml.load(path.read_text(encoding="utf-8"), _PlainLoader)
    except OSError as error:
        raise MapFileError(f"{path}: {error.strerror}, {expected}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        if isinstance(error, MapFileError):
            raise
        raise MapFileError(
            f"{path}: not readable as YAML ({' '.join(str(error).split())[:MAX_QUOTED]}), {expected}"
        ) from None
    if not isinstance(document, dict):
        raise MapFileError(f"{path}: no keys and values, {expected}")
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
    image, local = path.parent / name, path.parent / PureWindowsPath(name).name
    outside = not image.resolve().is_relative_to(path.parent.resolve())
    if image.is_file() and not (inside and outside):
        return image, None
    if local.is_file() and local.resolve().is_relative_to(path.parent.resolve()):
        return local, f"{path}: image: {name} does not exist here, {local} is read instead"
    if inside and outside:
        raise MapFileError(f"{path}: image: {name} lies outside of the map's folder, expected a file in it")
    raise MapFileError(f"{path}: image: {name} does not exist, nor does {local}, expected the picture of the map")


def _meaning(path: Path, document: dict[str, Any], mode: str, white: int) -> NDArray[np.float32]:
    """Return P(occupied) of each grey value by map_server's rules, (white + 1,), NaN = unknown."""
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
    shade = np.arange(white + 1, dtype=np.float32) / np.float32(white)
    unknown = np.float32(np.nan)
    if mode == "raw":
        percent = np.rint(shade * np.float32(255.0))
        return np.where(percent <= 100.0, percent / np.float32(100.0), unknown)
    probability = shade if str(negate).lower() in ("1", "true") else np.float32(1.0) - shade
    if "unknown_pixel" in document:
        return np.where(np.arange(white + 1) == _number(path, document, "unknown_pixel"), unknown, probability)
    between = probability if mode == "scale" else np.full_like(probability, unknown)
    known = np.where(probability > occupied, np.float32(1.0), between)
    return np.where(probability < free, np.float32(0.0), known)


def _unknown_greys(pixels: Pixels, meaning: NDArray[np.float32]) -> list[int]:
    """Return the greys that mean unknown although the thresholds make them known."""
    if pixels.white != 255:
        return []
    counts = np.bincount(pixels.grey.ravel(), minlength=256)
    found = []
    for grey in _UNKNOWN_GREYS:
        near = np.setdiff1d(np.arange(grey - 3, grey + 4), _UNKNOWN_GREYS)
        frequent = counts[grey] >= _MIN_UNKNOWN_SHARE * counts.sum() and counts[grey] >= _ISOLATION * counts[near].sum()
        others_are_free = counts[np.setdiff1d(np.flatnonzero(meaning == 0.0), _UNKNOWN_GREYS)].sum() > 0
        if frequent and others_are_free and not np.isnan(meaning[grey]):
            found.append(grey)
    return found


class _PlainLoader(yaml.SafeLoader):
    """Reads plain data without aliases: a few lines of them can stand for gigabytes, and no map needs them."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Read one value; raises ComposerError at an alias."""
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(None, None, "an alias (*), which a map does not need", mark)
        return super().compose_node(parent, index)
