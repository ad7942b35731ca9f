# SPDX-License-Identifier: MIT
"""What the greys of a map mean: by the rules of its `.yaml`, and by the habits of the programs that wrote the picture.

Sources: map_server's trinary, scale and raw (http://wiki.ros.org/map_server); rtabmap's `util3d::convertMap2Image8U`
(free 178 and 200, unknown 89, occupied 0); hector_geotiff's board of two greys for what is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worlds.format.pixels import Pixels

_UNKNOWN = (205, 127, 128)
"""Greys with which map_server, its savers and other programs mark unknown cells."""
_MIN_SHARE = 0.01
"""Smallest share of all pixels with such a grey that can mean unknown, against the thresholds of the file."""
_ISOLATION = 10
"""Such a grey means unknown if it is this many times as frequent as all greys within 3 of it: probabilities are not."""
_BLUR, _SHOULDER = 12, 18
"""A lossy picture spreads a grey over so many to both sides; between them and the shoulder there are few pixels."""
_RTABMAP = {0: 1.0, 89: np.nan, 178: 0.0, 200: 0.0}
_BOARD = (226, 237)
_MAX_OCCUPIED = 0.7
"""Largest share of the known cells that are occupied in a usual map."""

Meaning = NDArray[np.float32]


@dataclass(frozen=True)
class Thresholds:
    """Rules of map_server for what a grey means."""

    mode: str
    """`trinary`, `scale` or `raw`."""
    negate: bool
    """White is occupied."""
    occupied: float
    free: float
    unknown_pixel: float | None = None
    """The grey of unknown cells where all others are probabilities."""

    def meaning(self, white: int) -> Meaning:
        """Return P(occupied) of each grey value, (white + 1,), NaN = unknown."""
        shade = np.arange(white + 1, dtype=np.float32) / np.float32(white)
        unknown = np.float32(np.nan)
        if self.mode == "raw":
            percent = np.rint(shade * np.float32(255.0))
            return np.where(percent <= 100.0, percent / np.float32(100.0), unknown)
        probability = shade if self.negate else np.float32(1.0) - shade
        if self.unknown_pixel is not None:
            return np.where(np.arange(white + 1) == self.unknown_pixel, unknown, probability)
        between = probability if self.mode == "scale" else np.full_like(probability, unknown)
        known = np.where(probability > self.occupied, np.float32(1.0), between)
        return np.where(probability < self.free, np.float32(0.0), known)


def probabilities(pixels: Pixels, thresholds: Thresholds) -> tuple[Meaning, list[str]]:
    """Return P(occupied) of each pixel (rows, cols), NaN = unknown, and notes on greys that do not mean what the
    thresholds say, and on a map that looks turned inside out."""
    meaning, notes = thresholds.meaning(pixels.white), []
    if thresholds.mode != "raw" and thresholds.unknown_pixel is None and pixels.white == 255:
        notes = _by_habit(pixels, thresholds, meaning)
    found = meaning[pixels.grey]
    if pixels.transparent is not None:
        found[pixels.transparent] = np.nan
    occupied, known = int((found > 0.5).sum()), int((~np.isnan(found)).sum())
    if occupied > _MAX_OCCUPIED * known:
        share = occupied / known
        notes.append(f"{share:.0%} of the known cells are occupied: are negate, mode and the thresholds those of it?")
    if thresholds.mode == "raw" and not occupied and known:
        notes.append("no known cell is occupied: are negate, mode and the thresholds those of it?")
    return found, notes


def _by_habit(pixels: Pixels, thresholds: Thresholds, meaning: Meaning) -> list[str]:
    """Change what greys mean to what the program that wrote them meant; returns notes on it."""
    counts = np.bincount(pixels.grey.ravel(), minlength=256)
    if not thresholds.negate and _is_of_rtabmap(counts):
        for grey, probability in _RTABMAP.items():
            meaning[grey] = probability
        return ["greys are read as rtabmap writes them: 178 and 200 free, 89 unknown, 0 occupied"]
    notes = []
    for greys in _unknown_greys(pixels, counts, meaning):
        meaning[greys] = np.nan
        words = f"grey {greys[0]} is" if len(greys) == 1 else f"greys {' and '.join(map(str, greys))} are"
        if len(greys) > len(_BOARD):
            words = f"greys {greys[0]} to {greys[-1]} are"
        notes.append(
            f"{words} read as unknown, as map savers mean it, although free_thresh and occupied_thresh make it known"
        )
    return notes


def _is_of_rtabmap(counts: NDArray[np.int64]) -> bool:
    others = np.setdiff1d(np.arange(256), list(_RTABMAP))
    return not counts[others].any() and bool((counts[[89, 178]] >= _MIN_SHARE * counts.sum()).all())


def _unknown_greys(pixels: Pixels, counts: NDArray[np.int64], meaning: Meaning) -> list[list[int]]:
    """Return the greys that mean unknown although the thresholds make them known, in groups."""
    if _is_known_board(counts, meaning):
        return [list(_BOARD)]
    found = []
    for grey in _UNKNOWN:
        width, shoulder = (_BLUR, _SHOULDER) if pixels.lossy else (0, 3)
        group = [*range(grey - width, grey + width + 1)]
        around = np.setdiff1d(np.arange(grey - shoulder, grey + shoulder + 1), [*group, *_UNKNOWN])
        inside = counts[group].sum()
        frequent = inside >= _MIN_SHARE * counts.sum() and inside >= _ISOLATION * counts[around].sum()
        others_are_free = counts[np.setdiff1d(np.flatnonzero(meaning == 0.0), [*group, *_UNKNOWN])].sum() > 0
        if frequent and others_are_free and not np.isnan(meaning[group]).all():
            found.append(group)
    return found


def _is_known_board(counts: NDArray[np.int64], meaning: Meaning) -> bool:
    """Whether the two greys of a board are there, alone among those around them, and would be known."""
    board = list(_BOARD)
    near = np.setdiff1d(np.arange(min(board) - 3, max(board) + 4), board)
    frequent = (counts[board] >= _MIN_SHARE * counts.sum()).all() and counts[board].min() >= _ISOLATION * counts[
        near
    ].sum()
    return bool(frequent) and not np.isnan(meaning[board]).all() and bool(counts[255])
