# SPDX-License-Identifier: MIT
"""`testbed simulate --plan`: what a job will take in time and on disk, measured by some of its drives."""

from __future__ import annotations

import shutil
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbed.datasets.index import SPLITS, natural_order, splits
from testbed.datasets.lopsided import lopsided, time_shares

MAX_MEASURED, MEASURING_TIME = 12, 6.0
"""Drives are measured until there are this many, or until they have taken this long [s]; of each world and each lidar,
up to `MAX_KINDS` of them, one drive is measured however long that takes."""
MAX_KINDS = 40
"""Worlds, and lidars, of which a drive is measured for certain."""
MAX_NAMED = 6
"""Worlds of a split that are named."""
WORKER_START = 3.0
"""What the start of the workers takes [s]."""


class Kind(NamedTuple):
    """What drives have in common: those of one world are about as long, those of one lidar fill as much per second."""

    world: str
    """Name of the world, or kind of a generated one."""
    lidar: str
    """Names of the lidars."""


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
    expected: float = 1.0
    """How long it was expected to last, by the tour of its world."""


def measure_some(
    kinds: Sequence[Kind],
    make: Callable[[int], Measured],
    *,
    say: Callable[[str], object] = lambda _: None,
    clock: Callable[[], float] = time.monotonic,
) -> list[tuple[Kind, Measured]]:
    """Make some of the drives until `MEASURING_TIME` is over, at least one of each world and of each lidar.

    kinds: of each drive
    say: takes what is done before each drive, such as `measuring drive 3 of at most 12`
    Returns the kind of each drive that was made, and what it took.
    """
    started = clock()
    order, needed = _in_turn(kinds)
    measured: list[tuple[Kind, Measured]] = []
    chosen = order[: max(MAX_MEASURED, needed)]
    for number in chosen:
        if len(measured) >= needed and clock() - started > MEASURING_TIME:
            break
        most = "" if len(chosen) == needed else "at most "
        say(f"measuring drive {len(measured) + 1} of {most}{len(chosen)}")
        measured.append((kinds[number], make(number)))
    return measured


def _in_turn(kinds: Sequence[Kind]) -> tuple[list[int], int]:
    """Numbers of the drives in the order in which they are measured, and how many of them have to be.

    First comes one drive of each world and of each lidar, then one of each kind in turn; drives of one kind are spread
    over the job.
    """
    rng = np.random.default_rng(0)
    of_kind = {
        kind: rng.permutation([number for number, other in enumerate(kinds) if other == kind]).tolist()
        for kind in sorted(set(kinds))
    }
    first: list[Kind] = []
    for field in (0, 1):
        for value in sorted({kind[field] for kind in of_kind} - {kind[field] for kind in first})[:MAX_KINDS]:
            # of the kinds with this value the one whose other value was measured least
            first.append(
                min(
                    (kind for kind in of_kind if kind[field] == value),
                    key=lambda kind: sum(kind[1 - field] == other[1 - field] for other in first),
                )
            )
    needed = max(len(first), len(of_kind) if len(of_kind) <= MAX_MEASURED else 0)
    later = [kind for kind in of_kind if kind not in first]
    turns = [(turn, number) for kind in first + later for turn, number in enumerate(of_kind[kind])]
    return [number for _, number in sorted(turns, key=lambda item: item[0])], needed


def plan_lines(
    measured: Sequence[tuple[Kind, Measured]], drives: Sequence[tuple[Kind, float]], workers: int, out: Path
) -> list[str]:
    """What drives will take, as the measured ones do; whether the disk of `out` has room for them.

    drives: kind of each, and how long it is expected to last
    A drive lasts as much longer than expected as those of its world do on average; time and size of a simulated second
    are those of its kind, or of its lidar where the kind was not measured.
    """
    cost = seconds = metres = size = 0.0
    total: defaultdict[Kind, float] = defaultdict(float)
    for kind, expected in drives:
        total[kind] += expected
    for kind, expected in total.items():
        of_world = _sums(measured, Kind(kind.world, ""))
        of_kind = _sums(measured, kind, Kind("", kind.lidar))
        lasts = expected * _stretch(measured, kind)
        seconds += lasts
        metres += expected * of_world.metres / of_world.expected
        size += lasts * of_kind.size / of_kind.seconds
        cost += lasts * of_kind.cost / of_kind.seconds
    busy = min(workers, len(drives))
    left = timedelta(seconds=round(cost / busy + (WORKER_START if busy > 1 else 0.0)))
    lines = [
        f"about {size / 1e6:.0f} MB, {seconds / 3600:.2f} h of driving, {metres / 1000:.2f} km; it takes about {left} "
        f"with {busy} worker{'' if busy == 1 else 's'} (measured by {len(measured)} of the drives)"
    ]
    worlds = {kind.world for kind in total}
    if left_out := worlds - {kind.world for kind, _ in measured}:
        lines[0] += f"; not measured, estimated from the others: {len(left_out)} of {len(worlds)} worlds"
    if (free := free_space(out)) < size:
        lines.append(f"not enough space on this disk: {free / 1e9:.1f} GB")
    return lines


def lasting(measured: Sequence[tuple[Kind, Measured]], drives: Sequence[tuple[Kind, float]]) -> list[float]:
    """How long each drive will last [s]; arguments as for `plan_lines`."""
    stretch = {kind: _stretch(measured, kind) for kind in {kind for kind, _ in drives}}
    return [expected * stretch[kind] for kind, expected in drives]


def _stretch(measured: Sequence[tuple[Kind, Measured]], kind: Kind) -> float:
    """How much longer than expected the drives of a world last."""
    of_world = _sums(measured, Kind(kind.world, ""))
    return of_world.seconds / of_world.expected


def _sums(measured: Sequence[tuple[Kind, Measured]], *kinds: Kind) -> Measured:
    """Sums over the measured drives of the first of these kinds that has any, over all drives where none has.

    An empty name in a kind stands for any.
    """
    for wanted in (*kinds, Kind("", "")):
        chosen = [
            values
            for kind, values in measured
            if all(name in ("", there) for name, there in zip(wanted, kind, strict=True))
        ]
        if chosen:
            break
    return Measured(*(sum(values) for values in zip(*chosen, strict=True)))


def free_space(path: Path) -> int:
    """Free space on the disk of a path that need not exist [bytes]."""
    existing = next(parent for parent in (path, *path.resolve().parents) if parent.exists())
    return shutil.disk_usage(existing).free


def share_lines(seconds: Mapping[str, float], chosen: Mapping[str, str], out: Path) -> list[str]:
    """How much of the driving time each split has, and what to do where training has too little of it.

    seconds: driving time of each world of the collection [s]; chosen: as for `split_lines`
    """
    of_world = splits(seconds, {world: split for world, split in chosen.items() if world in seconds})
    advice = "" if chosen else lopsided(seconds, of_world, out)
    return [time_shares(seconds, of_world), *([advice] if advice else [])]


def worlds_by_split(worlds: Iterable[str], chosen: Mapping[str, str]) -> dict[str, list[str]]:
    """The worlds of each split, sorted; what decides it is known before anything is made.

    worlds: of all datasets that the collection will have
    chosen: splits that were chosen for some of them, see `testbed.datasets.index.splits`
    """
    names = set(worlds)
    of_world = splits(names, {world: split for world, split in chosen.items() if world in names})
    return {
        split: sorted((world for world, its_split in of_world.items() if its_split == split), key=natural_order)
        for split in SPLITS
    }


def split_lines(by_split: Mapping[str, Sequence[str]], *, were_chosen: bool) -> list[str]:
    """The worlds of each split, a line or two; were_chosen: whether the splits of some worlds were chosen before."""
    parts = []
    for split, inside in by_split.items():
        named = ", ".join(inside[:MAX_NAMED]) + (f" and {len(inside) - MAX_NAMED} more" if inside[MAX_NAMED:] else "")
        parts.append(f"{split}: {named or 'none'}")
    few = "three or more worlds give all splits; " if sum(map(len, by_split.values())) < len(SPLITS) else ""
    how = "as chosen before" if were_chosen else f"{few}`testbed datasets index --help` says how to choose them"
    return ["; ".join(parts), f"({how})"]
