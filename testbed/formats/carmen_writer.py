# SPDX-License-Identifier: MIT
"""CARMEN logs, written: `ROBOTLASER1` for any lidar, `FLASER` for those whose angles its readers imply."""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.files import write_aside
from slam import se2
from slam.scan import Scan
from testbed.formats.beams import even_spacing
from testbed.formats.carmen import FLASER_LAYOUTS
from testbed.formats.log import LogError
from testbed.frame import Frame

HOST = "testbed"


def write_carmen(
    path: str | Path, frames: Sequence[Frame], *, message: Literal["ROBOTLASER1", "FLASER"] = "ROBOTLASER1"
) -> None:
    """Write frames as a CARMEN log, gzip where the name ends in `.gz`; numbers keep all their digits.

    Truth goes into `TRUEPOS` lines. CARMEN has no place for `range_min` and the times of single beams, and `FLASER`
    none for the twist: readings that are no hit become 0 (invalid) or `range_max` (no return), the rest is left out.
    Raises LogError where the beams are not evenly spaced and, for `FLASER`, where its readers would imply other angles
    or the scans differ in mount or range. The file is written aside and renamed; equal frames give equal bytes.
    """
    path = Path(path)
    lines = _flaser_lines(path, frames) if message == "FLASER" else _robotlaser_lines(path, frames)
    text = "".join(f"{line}\n" for line in ("# CARMEN Logfile; metres, radians, seconds", *lines)).encode("ascii")
    with write_aside(path) as aside:
        aside.write_bytes(gzip.compress(text, mtime=0) if path.suffix == ".gz" else text)


def _robotlaser_lines(path: Path, frames: Sequence[Frame]) -> Iterator[str]:
    for index, frame in enumerate(frames):
        yield from _truth(frame)
        if frame.scan is None:
            yield _odom(frame)
            continue
        scan = frame.scan
        start, step = _even_angles(path, index, scan)
        laser = se2.compose(frame.odometry, scan.mount)
        twist = _twist(frame)
        yield (
            f"ROBOTLASER1 0 {_text([start, step * (scan.angles.size - 1), step, scan.range_max])} 0 0 "
            f"{_ranges(scan)} 0 {_text(laser)} {_text(frame.odometry)} {_text(twist)} 0 0 0 {_tail(frame)}"
        )


def _flaser_lines(path: Path, frames: Sequence[Frame]) -> Iterator[str]:
    first = next((frame.scan for frame in frames if frame.scan is not None), None)
    if first is None:
        raise LogError(f"{path}: no scans to write")
    if first.mount[1:] != (0.0, 0.0):
        raise LogError(f"{path}: FLASER has no place for a lidar mounted at {first.mount}: only an offset along x")
    yield f"PARAM robot_frontlaser_offset {first.mount[0]!r}"
    if math.isfinite(first.range_max):
        yield f"PARAM robot_front_laser_max {first.range_max!r}"
    for index, frame in enumerate(frames):
        yield from _truth(frame)
        if frame.scan is None:
            yield _odom(frame)
            continue
        scan = frame.scan
        if (scan.mount, scan.range_max) != (first.mount, first.range_max):
            raise LogError(f"{path}: frame {index}: FLASER has no place for scans that differ in mount or range_max")
        _check_flaser_angles(path, index, scan)
        laser = se2.compose(frame.odometry, scan.mount)
        yield f"FLASER {_ranges(scan)} {_text(laser)} {_text(frame.odometry)} {_tail(frame)}"


def _check_flaser_angles(path: Path, index: int, scan: Scan) -> None:
    count = scan.angles.size
    first, step = FLASER_LAYOUTS.get(count, (math.nan, math.nan))
    if not np.allclose(scan.angles, np.deg2rad(first + step * np.arange(count)), rtol=0.0, atol=1e-6):
        raise LogError(f"{path}: frame {index}: FLASER implies other angles for {count} beams: write ROBOTLASER1")


def _even_angles(path: Path, index: int, scan: Scan) -> tuple[float, float]:
    """First angle and step [rad] of evenly spaced beams."""
    spacing = even_spacing(scan.angles)
    if spacing is None:
        raise LogError(f"{path}: frame {index}: ROBOTLASER1 needs evenly spaced beams, these are not")
    return spacing


def _truth(frame: Frame) -> Iterator[str]:
    if frame.truth is not None:
        yield f"TRUEPOS {_text(frame.truth)} {_text(frame.odometry)} {_tail(frame)}"


def _odom(frame: Frame) -> str:
    return f"ODOM {_text(frame.odometry)} {_text(_twist(frame))} 0 {_tail(frame)}"


def _twist(frame: Frame) -> NDArray[np.float64]:
    """Translational and rotational velocity, NaN where unknown, (2,)."""
    return np.full(2, math.nan) if frame.twist is None else frame.twist[[0, 2]]


def _ranges(scan: Scan) -> str:
    """Their number and the ranges: hits as they are, the others as 0 or `range_max`."""
    kept = np.where(scan.hit, scan.ranges, np.where(scan.no_return, scan.range_max, 0.0))
    return f"{kept.size} {_text(kept)}".rstrip()


def _tail(frame: Frame) -> str:
    return f"{_text([frame.stamp])} {HOST} {_text([frame.stamp])}"


def _text(values: ArrayLike) -> str:
    return " ".join(map(repr, np.asarray(values, dtype=np.float64).tolist()))
