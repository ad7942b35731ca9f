# SPDX-License-Identifier: MIT
"""The frames of a run, which the final pass, the scores and the self-check go through again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from slam.scan import Scan
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.large_arrays import SEGMENT, ReadingsStore

READINGS_IN_MEMORY = 200_000_000
"""Readings of so many bytes stay in memory: ten minutes of 1081 beams at 40 Hz. Those of later scans go to files."""


class FrameStore(Sequence[Frame]):
    """Frames in the order in which they were processed, whose readings beyond `READINGS_IN_MEMORY` lie in files."""

    def __init__(self, in_memory: int = READINGS_IN_MEMORY) -> None:
        """in_memory: bytes of readings that stay in memory"""
        self._frames: list[Frame] = []
        self._readings = ReadingsStore(in_memory, np.float64)
        self._read = 0  # bytes since the memory of files was let go

    def append(self, frame: Frame) -> None:
        """Take in a frame. Raises OSError, naming the temporary folder, where there is no room for its readings."""
        if frame.scan is not None:
            frame = replace(frame, scan=replace(frame.scan, ranges=self._readings.keep(frame.scan.ranges)))
        self._frames.append(frame)

    def drop_last(self) -> None:
        """Forget the last frame; the room of its readings is not used again."""
        self._frames.pop()

    @property
    def stamps(self) -> NDArray[np.float64]:
        """Stamps [s], (frames,)."""
        return np.array([frame.stamp for frame in self._frames])

    @property
    def odometry(self) -> Pose:
        """`T_odom_robot`, (frames, 3)."""
        return np.array([frame.odometry for frame in self._frames])

    @property
    def with_scan(self) -> NDArray[np.intp]:
        """Numbers of the frames with a scan, (scans,)."""
        return np.flatnonzero([frame.scan is not None for frame in self._frames])

    @property
    def scans(self) -> Sequence[Scan | None]:
        """The scan of each frame, or None; read when it is asked for."""
        return _Scans(self)

    def scan(self, number: int) -> Scan | None:
        """Scan of the frame `number`, from 0."""
        scan = self._frames[number].scan
        if scan is None or not self._readings.is_full:
            return scan
        if self._read > SEGMENT:
            self._readings.forget()
            self._read = 0
        self._read += scan.ranges.nbytes
        return scan

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Frame]:
        return (self._frame(number) for number in range(len(self._frames)))

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        numbers = range(len(self._frames))[index]
        return self._frame(numbers) if isinstance(numbers, int) else [self._frame(number) for number in numbers]

    def _frame(self, number: int) -> Frame:
        self.scan(number)
        return self._frames[number]


class _Scans(Sequence[Scan | None]):
    """The scans of a store."""

    def __init__(self, store: FrameStore) -> None:
        self._store = store

    def __len__(self) -> int:
        return len(self._store)

    @overload
    def __getitem__(self, index: int) -> Scan | None: ...
    @overload
    def __getitem__(self, index: slice) -> list[Scan | None]: ...
    def __getitem__(self, index: int | slice) -> Scan | list[Scan | None] | None:
        numbers = range(len(self._store))[index]
        return self._store.scan(numbers) if isinstance(numbers, int) else [self._store.scan(k) for k in numbers]
