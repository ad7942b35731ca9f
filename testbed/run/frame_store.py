# SPDX-License-Identifier: MIT
"""The frames of a run, which the final pass, the scores and the self-check go through again."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import IO, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from slam.scan import Scan
from slam.se2 import Pose
from testbed.frame import Frame

READINGS_IN_MEMORY = 200_000_000
"""Readings of so many bytes stay in memory: ten minutes of 1081 beams at 40 Hz. Those of later scans go to a file."""


class _OnDisk(NamedTuple):
    """A scan without its readings, which are in the file."""

    begin: int
    """Its first reading in the file [bytes]."""
    without_readings: Scan
    """The scan with zeros in place of its readings."""

    def read(self, file: IO[bytes]) -> Scan:
        """Return the scan with its readings."""
        count = 8 * len(self.without_readings.angles)
        ranges = np.frombuffer(os.pread(file.fileno(), count, self.begin), dtype=np.float64).copy()
        return replace(self.without_readings, ranges=ranges)


class FrameStore(Sequence[Frame]):
    """Frames in the order in which they were processed.

    The readings beyond `READINGS_IN_MEMORY` are in a temporary file without a name, which is gone with the store; a
    frame that is asked for gets them back to the bit.
    """

    def __init__(self, in_memory: int = READINGS_IN_MEMORY) -> None:
        """in_memory: bytes of readings that stay in memory"""
        self._frames: list[Frame] = []  # those of scans in the file are without their scan
        self._on_disk: dict[int, _OnDisk] = {}
        self._left, self._end = in_memory, 0
        self._file: IO[bytes] | None = None
        self._zeros: dict[int, NDArray[np.float64]] = {}  # shared, by the number of beams

    def append(self, frame: Frame) -> None:
        """Take in a frame. Raises OSError, naming the temporary folder, where there is no room for its readings."""
        scan = frame.scan
        if scan is None or scan.ranges.nbytes <= self._left:
            self._left -= 0 if scan is None else scan.ranges.nbytes
            self._frames.append(frame)
            return
        self._on_disk[len(self._frames)] = _OnDisk(self._end, replace(scan, ranges=self._no_readings(len(scan.angles))))
        self._write(np.ascontiguousarray(scan.ranges, dtype=np.float64).tobytes())
        self._frames.append(replace(frame, scan=None))

    def drop_last(self) -> None:
        """Forget the last frame; the room of its readings is not used again."""
        self._frames.pop()
        self._on_disk.pop(len(self._frames), None)

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
        return np.flatnonzero([f.scan is not None or k in self._on_disk for k, f in enumerate(self._frames)])

    @property
    def scans(self) -> Sequence[Scan | None]:
        """The scan of each frame, or None; read when it is asked for."""
        return _Scans(self)

    def scan(self, number: int) -> Scan | None:
        """Scan of the frame `number`, from 0."""
        on_disk = self._on_disk.get(number)
        if on_disk is None:
            return self._frames[number].scan
        assert self._file is not None
        return on_disk.read(self._file)

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
        frame = self._frames[number]
        return replace(frame, scan=self.scan(number)) if number in self._on_disk else frame

    def _no_readings(self, beams: int) -> NDArray[np.float64]:
        return self._zeros.setdefault(beams, np.zeros(beams))

    def _write(self, readings: bytes) -> None:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - it lives as long as the store
            if os.pwrite(self._file.fileno(), readings, self._end) < len(readings):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            reason = f"{error.strerror}, for the scans of a long run"
            raise OSError(error.errno, reason, tempfile.gettempdir()) from None
        self._end += len(readings)


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
