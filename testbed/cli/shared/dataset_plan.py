# SPDX-License-Identifier: MIT
"""`testbed simulate --plan`: what a job will take in time and on disk, measured by some of its drives."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbed.datasets.index import SPLITS, splits

MAX_MEASURED, MEASURING_TIME = 12, 6.0
"""Drives are measured until there are this many, or until they have taken this long [s]."""
MAX_NAMED = 6
"""Worlds of a split that are named."""
WORKER_START = 3.0
"""What the start of the workers takes [s]."""


class Measured(NamedTuple):
    """One drive that was made to measure."""

    cost: float
    """Time that making it took [s]."""
    seconds: float
    """Simulated time [s]."""
    metres: float
    """Length of the path [m]."""
    size: int
    """Size of its files [bytes]."""


def measure_some(
    kinds: Sequence[str], make: Callable[[int], Measured], *, clock: Callable[[], float] = time.monotonic
) -> list[tuple[str, Measured]]:
    """Make some of the drives until `MEASURING_TIME` is over, at least one of each of the first kinds.

    kinds: of each drive, such as its world and lidar: drives of one kind are alike
    Returns the kind of each drive that was made, and what it took.
    """
    started = clock()
    measured: list[tuple[str, Measured]] = []
    for number in _in_turn(kinds)[:MAX_MEASURED]:
        if len(measured) >= len(set(kinds)) and clock() - started > MEASURING_TIME:
            break
        measured.append((kinds[number], make(number)))
    return measured


def _in_turn(kinds: Sequence[str]) -> list[int]:
    """Numbers of the drives, one of each kind in turn; those of one kind are spread over the job."""
    rng = np.random.default_rng(0)
    turns = [
        (turn, int(number))
        for kind in sorted(set(kinds))
        for turn, number in enumerate(rng.permutation(np.flatnonzero(np.array(kinds) == kind)))
    ]
    return [number for _, number in sorted(turns, key=lambda item: item[0])]


def plan_lines(measured: Sequence[tuple[str, Measured]], kinds: Sequence[str], workers: int, out: Path) -> list[str]:
    """What drives of these kinds will take, as the measured ones of their kind do; free space on the disk of `out`."""
    everything = np.mean([values for _, values in measured], axis=0)
    totals = np.zeros(len(Measured._fields))
    for kind, count in Counter(kinds).items():
        of_kind = [values for measured_kind, values in measured if measured_kind == kind]
        totals += count * (np.mean(of_kind, axis=0) if of_kind else everything)
    cost, seconds, metres, size = totals.tolist()
    busy = min(workers, len(kinds))
    left = timedelta(seconds=round(cost / busy + (WORKER_START if busy > 1 else 0.0)))
    lines = [
        f"about {size / 1e6:.0f} MB, {seconds / 3600:.2f} h of driving, {metres / 1000:.2f} km; it takes about {left} "
        f"with {busy} worker{'' if busy == 1 else 's'} (measured by {len(measured)} of the drives)"
    ]
    if left_out := sorted(set(kinds) - {kind for kind, _ in measured}):
        lines[0] += f"; not measured, taken as the mean of the others: {len(left_out)} of {len(set(kinds))} kinds"
    existing = next(path for path in (out, *out.resolve().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    lines.append(f"free on this disk: {free / 1e9:.1f} GB" + (": not enough" if free < size else ""))
    return lines


def split_line(worlds: Sequence[str]) -> str:
    """The worlds of each split, as a hash of their names decides."""
    of_world = splits(worlds)
    parts = []
    for split in SPLITS:
        names = sorted(world for world, chosen in of_world.items() if chosen == split)
        named = ", ".join(names[:MAX_NAMED]) + (f" and {len(names) - MAX_NAMED} more" if names[MAX_NAMED:] else "")
        parts.append(f"{split}: {named or 'none'}")
    few = "" if len(of_world) > 2 else "; three or more worlds give all splits"
    return "; ".join(parts) + few
