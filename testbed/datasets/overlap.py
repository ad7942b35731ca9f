# SPDX-License-Identifier: MIT
"""How much of its way a drive has in common with the other drives of its world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.files.tum import read_tum

STEP = 0.5
"""Distance between the points of a path that are compared [m]."""
NEAR = 0.3
"""Two paths pass the same place where they are this close [m]."""
SAME_DIRECTION = np.cos(np.deg2rad(45.0))
"""They drive in the same direction where the angle between them is smaller than this."""
FINER = 10
"""Points on each step of a path that the distance to it is measured to."""
MAX_LENGTH = 500.0
"""Of longer paths only the beginning is compared [m]."""
MAX_PAIRS = 2000
"""Pairs of drives that are compared in one collection; of more, evenly chosen ones."""

DEFINITION = (
    f"Both paths are cut into steps of {STEP:g} m. A step of one drive and a step of the other match where they are "
    f"less than {NEAR:g} m apart and their directions differ by less than 45 degrees. Steps that match are paired so "
    "that the pairs follow each other in the same order in both drives; `overlap` is the largest possible number of "
    "pairs, divided by the number of steps of the drive (a longest common subsequence). `same_places` is the share of "
    f"its steps that are less than {NEAR:g} m from the path of the other drive. Only the first {MAX_LENGTH:g} m of a "
    f"drive count. At most about {MAX_PAIRS} pairs of drives are compared in a collection, as many in each world: of "
    "more, evenly chosen ones, so that drives of large collections may have more in common."
)
"""What the columns of the index mean, for the card."""

Floats = NDArray[np.float64]


class Overlap(NamedTuple):
    """Largest shares of its way that a drive has in common with another one; None where there is no other one."""

    overlap: float | None = None
    """In the same direction and order."""
    same_places: float | None = None
    """In any direction and order."""


class _Path(NamedTuple):
    """A path in even steps."""

    points: Floats
    """(n, 2) [m]."""
    directions: Floats
    """Unit vectors, (n, 2)."""


def largest_overlaps(directory: Path, rows: Sequence[Mapping[str, Any]]) -> list[Overlap]:
    """For each row of the index: the largest shares of its way that another drive of the same world has too.

    `DEFINITION` says what counts. Sensor variants of one drive count as one.
    """
    drives: dict[str, dict[int, str]] = {}
    for row in rows:
        drives.setdefault(row["world"], {}).setdefault(row["seed"], row["dataset"])
    largest: dict[tuple[str, int], tuple[float, float]] = {}
    several = {world: datasets for world, datasets in drives.items() if len(datasets) > 1}
    for world, datasets in several.items():
        paths = [_read(directory / name / "truth.tum") for name in datasets.values()]
        keys = [(world, seed) for seed in datasets]
        for first, second in _pairs(len(paths), MAX_PAIRS // len(several)):
            common = common_steps(paths[first], paths[second])
            for drive, other in ((first, second), (second, first)):
                share, places = common / len(paths[drive].points), share_of_places(paths[drive], paths[other])
                before = largest.get(keys[drive], (0.0, 0.0))
                largest[keys[drive]] = max(before[0], round(share, 3)), max(before[1], round(places, 3))
    return [Overlap(*largest.get((row["world"], row["seed"]), (None, None))) for row in rows]


def common_steps(first: _Path, second: _Path) -> int:
    """Largest number of steps of two paths that can be paired in order: a longest common subsequence."""
    best = np.zeros(len(second.points) + 1, dtype=np.int64)
    for point, direction in zip(first.points, first.directions, strict=True):
        same = np.hypot(*(second.points - point).T) < NEAR
        same &= second.directions @ direction > SAME_DIRECTION
        longer = best.copy()
        longer[1:] = np.maximum(best[1:], best[:-1] + same)
        best = np.maximum.accumulate(longer)
    return int(best[-1])


def share_of_places(path: _Path, other: _Path) -> float:
    """Share of the steps of a path that are nearer than `NEAR` to another path, in any direction and order."""
    from scipy.spatial import cKDTree  # here: its import takes a tenth of the start of `testbed simulate`

    between = [k / FINER for k in range(FINER)]
    fine = [other.points[:-1] + share * np.diff(other.points, axis=0) for share in between]
    distances, _ = cKDTree(np.concatenate([*fine, other.points[-1:]])).query(path.points)
    return float(np.mean(distances < NEAR))


def path_in_steps(positions: Floats) -> _Path:
    """The path through positions (n, 2) [m] in steps of `STEP`."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
    moved = np.concatenate([[True], np.diff(lengths) > 0.0])
    at = np.arange(0.0, min(lengths[-1], MAX_LENGTH) + 0.5 * STEP, STEP)
    points = np.column_stack([np.interp(at, lengths[moved], positions[moved, axis]) for axis in (0, 1)])
    steps = np.diff(points, axis=0, append=2.0 * points[-1:] - points[-2:-1] if len(points) > 1 else points[-1:])
    return _Path(points, steps / np.maximum(np.hypot(*steps.T), 1e-12)[:, None])


def _read(truth: Path) -> _Path:
    return path_in_steps(read_tum(truth).poses[:, :2])


def _pairs(count: int, limit: int) -> Iterator[tuple[int, int]]:
    """Pairs of the numbers below `count`: all, or about `limit` of them in which each number is equally often."""
    if count * (count - 1) // 2 <= limit:
        yield from combinations(range(count), 2)
        return
    for distance in np.unique(np.linspace(1, (count - 1) // 2, max(limit // count, 1)).astype(int)).tolist():
        for number in range(count):
            yield number, (number + distance) % count
