# SPDX-License-Identifier: MIT
"""The scans of a bag in columns: an object for each would take as much memory as its readings on disk.

What scans say of themselves (frame, angles, limits) is mostly the same for all of a topic and is kept once; readings
lie one after the other, those beyond a limit in a temporary file.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.formats.ros.reading.decode import RawScan
from testbed.frame_table import Floats, Integers
from testbed.large_arrays import ReadingsColumn, gathered

COLUMNS = ("stamps", "beats", "heads", "sizes", "numbers", "starts")
"""Of `RawScans`."""


class Head(NamedTuple):
    """What a scan says of itself, but its time and the time between its beams."""

    frame_id: str
    angle_min: float
    angle_max: float
    angle_increment: float
    range_min: float
    range_max: float
    source: str
    """What it was read of, with {} for its number."""


class ScanStore:
    """What the scans of all topics of a bag share."""

    def __init__(self) -> None:
        self.readings = ReadingsColumn()
        self.heads: list[Head] = []
        self._known: dict[Head, int] = {}

    def number_of(self, head: Head) -> int:
        """Number of a head, which is kept once."""
        number = self._known.setdefault(head, len(self.heads))
        if number == len(self.heads):
            self.heads.append(head)
        return number


class ScanRecorder:
    """Takes in the scans of one topic, one by one."""

    def __init__(self, store: ScanStore) -> None:
        self._store = store
        self._stamps, self._beats, self._starts = array("d"), array("d"), array("q")
        self._heads, self._sizes, self._numbers = array("q"), array("q"), array("q")

    def take(self, scan: RawScan, number: int, source: str) -> None:
        """Take in a scan; number: of the message, from 1; source: what it was read of, with {} for the number.

        Raises OSError, naming the temporary folder, where there is no room for the readings.
        """
        first, last, step = _one_nan(scan.angle_min), _one_nan(scan.angle_max), _one_nan(scan.angle_increment)
        head = Head(scan.frame_id, first, last, step, _one_nan(scan.range_min), _one_nan(scan.range_max), source)
        self._stamps.append(scan.stamp)
        self._beats.append(scan.time_increment)
        self._heads.append(self._store.number_of(head))
        self._sizes.append(scan.ranges.size)
        self._numbers.append(number)
        self._starts.append(self._store.readings.append(scan.ranges))

    def finish(self) -> RawScans:
        """All scans that were taken in; more cannot be."""
        return RawScans(
            store=self._store,
            stamps=np.frombuffer(self._stamps),
            beats=np.frombuffer(self._beats),
            heads=np.frombuffer(self._heads, dtype=np.int64),
            sizes=np.frombuffer(self._sizes, dtype=np.int64),
            numbers=np.frombuffer(self._numbers, dtype=np.int64),
            starts=np.frombuffer(self._starts, dtype=np.int64),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RawScans:
    """LaserScan messages, `n` of them."""

    store: ScanStore
    stamps: Floats
    """[s], (n,)."""
    beats: Floats
    """Time between two beams of each [s], (n,)."""
    heads: Integers
    """Number of the head of each in the store, (n,)."""
    sizes: Integers
    """Readings of each, (n,)."""
    numbers: Integers
    """Counts the messages that are read, from 1, (n,)."""
    starts: Integers
    """First reading of each in the store, (n,)."""

    def __len__(self) -> int:
        return len(self.stamps)

    def chosen(self, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> RawScans:
        """Some of the scans."""
        columns: dict[str, Any] = {name: getattr(self, name)[rows] for name in COLUMNS}
        return replace(self, **columns)

    def at(self, stamps: Floats) -> RawScans:
        """The same scans at other times (n,) [s]."""
        return replace(self, stamps=stamps)

    def head(self, row: int) -> Head:
        """What a scan says of itself."""
        return self.store.heads[int(self.heads[row])]

    def ranges_of(self, row: int) -> NDArray[np.float32]:
        """The readings of a scan [m], (beams,)."""
        begin = int(self.starts[row])
        return self.store.readings.array()[begin : begin + int(self.sizes[row])]

    def place(self, row: int) -> str:
        """Where in the bag a scan is, for messages to the user."""
        return self.head(row).source.format(self.numbers[row])

    @property
    def frames(self) -> list[str]:
        """The frames of the scans, each once, in the order in which they come first."""
        used, first = np.unique(self.heads, return_index=True)
        return list(dict.fromkeys(self.store.heads[used[k]].frame_id for k in np.argsort(first).tolist()))

    def in_frame(self, frame_id: str) -> NDArray[np.bool_]:
        """Tell which scans have a frame, (n,)."""
        matching = np.array([head.frame_id == frame_id for head in self.store.heads], dtype=bool)
        return matching[self.heads]

    def ranges(self) -> NDArray[np.float32]:
        """The readings of all scans, one after the other [m], (readings,); in a file where they are many."""
        whole = self.store.readings.array()
        if (self.starts[1:] == self.starts[:-1] + self.sizes[:-1]).all():
            begin = int(self.starts[0]) if len(self) else 0
            return whole[begin : begin + int(self.sizes.sum())]
        return gathered(whole, self.starts, self.sizes)


def _one_nan(number: float) -> float:
    """The same number; NaN is equal to nothing but the very same object."""
    return math.nan if math.isnan(number) else number


def in_order_of_time(parts: Sequence[RawScans]) -> RawScans:
    """The scans of several topics of one bag as one column, sorted by their stamps."""
    first, *others = parts
    if not others and (np.diff(first.stamps) >= 0.0).all():
        return first
    columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    joined = replace(first, **columns)
    return joined.chosen(np.argsort(joined.stamps, kind="stable"))
