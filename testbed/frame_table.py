# SPDX-License-Identifier: MIT
"""Many frames as arrays: the one representation that all readers fill and all writers take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from slam.scan import Scan
from testbed.frame import Frame
from testbed.large_arrays import forget_pages, joined

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BLOCK_FRAMES = 256
"""Frames that writers take at a time: some 13 s of a drive, 1 to 4 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BeamPattern:
    """Directions and times of the beams of a scan; most recordings have one pattern, or a few."""

    angles: Floats
    """Direction of each beam in the lidar's frame [rad], (beams,)."""
    time_offsets: Floats | None
    """Time of each beam after the scan's stamp [s], (beams,); None = all beams at once, or unknown."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameTable:
    """`n` frames, `m` of them with a scan, in the order of the recording. NaN in all columns of a row = unknown."""

    stamps: Floats
    """Time of each frame [s], (n,)."""
    odometry: Floats
    """`T_odom_robot` [m, m, rad], (n, 3)."""
    twist: Floats
    """Velocity in the robot's frame, as the odometry saw it [m/s, m/s, rad/s], (n, 3)."""
    command: Floats
    """Commanded speed and turn rate [m/s, rad/s], (n, 2)."""
    truth: Floats
    """`T_world_robot` [m, m, rad], (n, 3)."""
    scan_rows: Integers
    """Frame of each scan, increasing, (m,)."""
    scan_lidars: Integers
    """Lidar of each scan, as an index into `lidars`, (m,)."""
    scan_patterns: Integers
    """Beam pattern of each scan, as an index into `patterns`, (m,)."""
    scan_starts: Integers
    """First reading of each scan in `ranges`, and the end, (m + 1,)."""
    ranges: NDArray[np.float64] | NDArray[np.float32]
    """Readings of all scans, one after the other [m], (readings,)."""
    range_limits: Floats
    """`range_min`, `range_max` of each scan [m], (m, 2)."""
    mounts: Floats
    """`T_robot_lidar` of each scan [m, m, rad], (m, 3)."""
    lidars: tuple[str, ...]
    """Names of the lidars."""
    patterns: tuple[BeamPattern, ...]
    """The distinct beam patterns."""
    first: int = 0
    """Number of the first frame in the whole recording, for messages to the user."""

    def __len__(self) -> int:
        return len(self.stamps)

    @classmethod
    def from_frames(cls, frames: Sequence[Frame], first: int = 0) -> FrameTable:
        """Gather frames into arrays."""
        scans = [frame.scan for frame in frames if frame.scan is not None]
        names = [frame.lidar for frame in frames if frame.scan is not None]
        lidars = {name: k for k, name in enumerate(dict.fromkeys(names))}
        patterns, numbers = _patterns(scans)
        return cls(
            stamps=np.array([frame.stamp for frame in frames], dtype=np.float64),
            odometry=_rows([frame.odometry for frame in frames], 3),
            twist=_rows([frame.twist for frame in frames], 3),
            command=_rows([frame.command for frame in frames], 2),
            truth=_rows([frame.truth for frame in frames], 3),
            scan_rows=np.array([k for k, frame in enumerate(frames) if frame.scan is not None], dtype=np.int64),
            scan_lidars=np.array([lidars[name] for name in names], dtype=np.int64),
            scan_patterns=numbers,
            scan_starts=np.cumsum([0, *(scan.ranges.size for scan in scans)], dtype=np.int64),
            ranges=joined([scan.ranges for scan in scans]) if scans else np.empty(0),
            range_limits=_rows([(scan.range_min, scan.range_max) for scan in scans], 2),
            mounts=_rows([scan.mount for scan in scans], 3),
            lidars=tuple(lidars),
            patterns=patterns,
            first=first,
        )

    def frames(self) -> list[Frame]:
        """The same as a list of frames; each owns its readings, and scans of one pattern share their angles."""
        frames: list[Frame] = []
        scan_of = dict(zip(self.scan_rows.tolist(), range(len(self.scan_rows)), strict=True))
        columns = (self.odometry, _known(self.twist), _known(self.command), _known(self.truth))
        for row, (stamp, odometry, twist, command, truth) in enumerate(
            zip(self.stamps.tolist(), *columns, strict=True)
        ):
            number = scan_of.get(row)
            frames.append(
                Frame(
                    stamp=stamp,
                    odometry=odometry,
                    scan=None if number is None else self.scan(number),
                    lidar=Frame.lidar if number is None else self.lidars[self.scan_lidars[number]],
                    twist=twist,
                    command=None if command is None else (float(command[0]), float(command[1])),
                    truth=truth,
                )
            )
        return frames

    def scan(self, number: int) -> Scan:
        """Scan `number`, counted from 0."""
        pattern = self.patterns[self.scan_patterns[number]]
        range_min, range_max = self.range_limits[number].tolist()
        x, y, theta = self.mounts[number].tolist()
        return Scan(
            ranges=self.ranges[self.scan_starts[number] : self.scan_starts[number + 1]].astype(np.float64),
            angles=pattern.angles,
            range_min=range_min,
            range_max=range_max,
            stamp=float(self.stamps[self.scan_rows[number]]),
            mount=(x, y, theta),
            time_offsets=pattern.time_offsets,
        )

    def rows(self, begin: int, end: int) -> FrameTable:
        """Frames `begin` to `end`, without the latter; the arrays are views."""
        low, high = np.searchsorted(self.scan_rows, [begin, end]).tolist()
        starts = self.scan_starts[low : high + 1]
        return replace(
            self,
            stamps=self.stamps[begin:end],
            odometry=self.odometry[begin:end],
            twist=self.twist[begin:end],
            command=self.command[begin:end],
            truth=self.truth[begin:end],
            scan_rows=self.scan_rows[low:high] - begin,
            scan_lidars=self.scan_lidars[low:high],
            scan_patterns=self.scan_patterns[low:high],
            scan_starts=starts - starts[0],
            ranges=self.ranges[starts[0] : starts[-1]],
            range_limits=self.range_limits[low:high],
            mounts=self.mounts[low:high],
            first=self.first + begin,
        )

    def blocks(self) -> Iterator[FrameTable]:
        """All frames in pieces of `BLOCK_FRAMES`."""
        for begin in range(0, len(self), BLOCK_FRAMES):
            yield self.rows(begin, min(begin + BLOCK_FRAMES, len(self)))

    @property
    def readings(self) -> Integers:
        """Number of readings of each scan, (m,)."""
        return np.diff(self.scan_starts)

    def known(self, column: Floats) -> NDArray[np.bool_]:
        """Tell which rows of a column such as `truth` are known, (n,)."""
        known: NDArray[np.bool_] = (~np.isnan(column)).any(axis=1).reshape(-1)
        return known


class TableFrames(Sequence[Frame]):
    """The frames of a table, made when they are asked for: not all are in memory at a time."""

    def __init__(self, table: FrameTable) -> None:
        self._table = table

    def __len__(self) -> int:
        return len(self._table)

    def __iter__(self) -> Iterator[Frame]:
        for block in self._table.blocks():
            yield from block.frames()
            forget_pages(self._table.ranges)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        numbers = range(len(self))[index]
        return self._frame(numbers) if isinstance(numbers, int) else [self._frame(number) for number in numbers]

    def _frame(self, number: int) -> Frame:
        return self._table.rows(number, number + 1).frames()[0]


def _rows(values: Sequence[Sequence[float] | Floats | None], width: int) -> Floats:
    """Rows (n, width), NaN for None."""
    unknown = (np.nan,) * width
    rows = [unknown if value is None else value for value in values]
    return np.array(rows, dtype=np.float64).reshape(len(rows), width)


def _known(column: Floats) -> list[Floats | None]:
    """The rows of a column, None where unknown."""
    unknown: list[bool] = np.asarray(np.isnan(column).all(axis=1)).tolist()
    return [None if missing else row for row, missing in zip(column, unknown, strict=True)]


def _patterns(scans: Sequence[Scan]) -> tuple[tuple[BeamPattern, ...], Integers]:
    """The distinct beam patterns of scans, and the number of each scan's pattern (m,).

    Scans that share their arrays, as the simulator's do, are recognised without a comparison of the content.
    """
    by_identity: dict[tuple[int, int], int] = {}
    by_content: dict[tuple[bytes, bytes | None], int] = {}
    patterns: list[BeamPattern] = []
    numbers = []
    for scan in scans:
        identity = id(scan.angles), id(scan.time_offsets)
        number = by_identity.get(identity)
        if number is None:
            times = scan.time_offsets
            content = scan.angles.tobytes(), None if times is None else times.tobytes()
            number = by_identity[identity] = by_content.setdefault(content, len(patterns))
            if number == len(patterns):
                patterns.append(BeamPattern(angles=scan.angles, time_offsets=times))
        numbers.append(number)
    return tuple(patterns), np.array(numbers, dtype=np.int64)
