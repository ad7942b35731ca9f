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
from testbed.frame_table import BLOCK_FRAMES, FrameTable
from testbed.large_arrays import SEGMENT, ReadingsStore

READINGS_IN_MEMORY = 50_000_000
"""Readings of so many bytes stay in memory: half an hour of 360 beams at 10 Hz. Those of later scans go to files."""


class FrameStore(Sequence[Frame]):
    """Frames in the order in which they were processed, made again when they are asked for.

    They are kept as arrays, `BLOCK_FRAMES` at a time, since an object for each takes ten times the memory; readings
    beyond `READINGS_IN_MEMORY` lie in files.
    """

    def __init__(self, in_memory: int = READINGS_IN_MEMORY) -> None:
        """in_memory: bytes of readings that stay in memory"""
        self._blocks: list[FrameTable] = []
        self._latest: list[Frame] = []  # not yet a block
        self._readings = ReadingsStore(in_memory, np.float64)
        self._read = 0  # bytes since the memory of files was let go

    def append(self, frame: Frame) -> None:
        """Take in a frame. Raises OSError, naming the temporary folder, where there is no room for its readings."""
        if frame.scan is not None and frame.scan.ranges.base is not None:  # a part of something large
            frame = replace(frame, scan=replace(frame.scan, ranges=frame.scan.ranges.copy()))
        if len(self._latest) == BLOCK_FRAMES:
            block = FrameTable.from_frames(self._latest, first=len(self) - BLOCK_FRAMES)
            ranges = self._readings.keep(np.asarray(block.ranges, dtype=np.float64))
            self._blocks.append(replace(block, ranges=ranges))
            self._latest = []
        self._latest.append(frame)

    def drop_last(self) -> None:
        """Forget the last frame, right after it was taken in."""
        self._latest.pop()

    @property
    def stamps(self) -> NDArray[np.float64]:
        """Stamps [s], (frames,)."""
        latest = np.array([frame.stamp for frame in self._latest], dtype=np.float64)
        return np.concatenate([*(block.stamps for block in self._blocks), latest])

    @property
    def odometry(self) -> Pose:
        """`T_odom_robot`, (frames, 3)."""
        latest = np.array([frame.odometry for frame in self._latest], dtype=np.float64).reshape(-1, 3)
        return np.concatenate([*(block.odometry for block in self._blocks), latest])

    @property
    def with_scan(self) -> NDArray[np.intp]:
        """Numbers of the frames with a scan, (scans,)."""
        latest = np.flatnonzero([frame.scan is not None for frame in self._latest])
        begin = len(self) - len(self._latest)
        return np.concatenate([*(block.first + block.scan_rows for block in self._blocks), begin + latest])

    @property
    def scans(self) -> Sequence[Scan | None]:
        """The scan of each frame, or None; read when it is asked for."""
        return _Scans(self)

    def scan(self, number: int) -> Scan | None:
        """Scan of the frame `number`, from 0."""
        place, row = divmod(number, BLOCK_FRAMES)
        if place == len(self._blocks):
            return self._latest[row].scan
        block = self._blocks[place]
        found = int(np.searchsorted(block.scan_rows, row))
        if found == len(block.scan_rows) or block.scan_rows[found] != row:
            return None
        scan = block.scan(found)
        self._let_go(scan.ranges.nbytes)
        return scan

    def __len__(self) -> int:
        return BLOCK_FRAMES * len(self._blocks) + len(self._latest)

    def __iter__(self) -> Iterator[Frame]:
        for block in self._blocks:
            yield from block.frames()
            self._let_go(block.ranges.nbytes)
        yield from self._latest

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        numbers = range(len(self))[index]
        return self._frame(numbers) if isinstance(numbers, int) else [self._frame(number) for number in numbers]

    def _frame(self, number: int) -> Frame:
        place, row = divmod(number, BLOCK_FRAMES)
        if place == len(self._blocks):
            return self._latest[row]
        (frame,) = self._blocks[place].rows(row, row + 1).frames()
        self._let_go(0 if frame.scan is None else frame.scan.ranges.nbytes)
        return frame

    def _let_go(self, read: int) -> None:
        """Count bytes that were read; those in files are let go of now and then."""
        self._read += read
        if self._readings.is_full and self._read > SEGMENT:
            self._readings.forget()
            self._read = 0


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
