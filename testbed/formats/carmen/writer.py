# SPDX-License-Identifier: MIT
"""CARMEN logs, written: `ROBOTLASER1` for any lidar, `FLASER` for those whose angles its readers imply."""

from __future__ import annotations

import gzip
import hashlib
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.files.atomic_write import atomic_write
from slam import se2
from slam.scan import Scan
from testbed.formats.beams import even_spacing, same_mount
from testbed.formats.carmen.reader import FLASER_LAYOUTS, LIDARS, MAXIMA, OFFSETS, SEAL, SEALED
from testbed.formats.log import LogError
from testbed.frame import Frame

HOST = "testbed"


def write_carmen(
    path: str | Path, frames: Sequence[Frame], *, message: Literal["ROBOTLASER", "FLASER"] = "ROBOTLASER"
) -> None:
    """Write frames as a CARMEN log, gzip where the name ends in `.gz`; numbers keep all their digits.

    The scans of one lidar become `ROBOTLASER1` or `FLASER` lines, those of a second one `ROBOTLASER2` or `RLASER`.
    Truth goes into `TRUEPOS` lines. CARMEN has no place for commands, `range_min` and the times of single beams, and
    `FLASER` none for the twist: readings that are no hit become 0 (invalid) or `range_max` (no return), the rest is
    left out. Raises LogError where there are more lidars, where beams are not evenly spaced and, for `FLASER`, where
    its readers would imply other angles or the scans of a lidar differ in mount or range. The file is written aside
    and renamed; its last line holds the SHA-256 of all others; equal frames give equal bytes.
    """
    path = Path(path)
    kinds = _kinds(path, frames, message)
    lines = (_flaser_lines if message == "FLASER" else _robotlaser_lines)(path, frames, kinds)
    text = "".join(f"{line}\n" for line in (SEALED, *lines)).encode("ascii")
    text += f"{SEAL}{hashlib.sha256(text).hexdigest()}\n".encode("ascii")
    with atomic_write(path) as aside:
        aside.write_bytes(gzip.compress(text, mtime=0) if path.suffix == ".gz" else text)


def _kinds(path: Path, frames: Sequence[Frame], message: str) -> dict[str, str]:
    """Kind of message for each lidar: a rear one comes second, else their order of appearance counts."""
    kinds = ("FLASER", "RLASER") if message == "FLASER" else ("ROBOTLASER1", "ROBOTLASER2")
    lidars = dict.fromkeys(frame.lidar for frame in frames if frame.scan is not None)
    if len(lidars) > len(kinds):
        raise LogError(f"{path}: scans of {len(lidars)} lidars ({', '.join(lidars)}), CARMEN has a front and a rear")
    rear = LIDARS[kinds[1]]
    others = [name for name in lidars if name != rear]
    return dict(zip(others, kinds, strict=False)) | ({rear: kinds[1]} if rear in lidars else {})


def _robotlaser_lines(path: Path, frames: Sequence[Frame], kinds: dict[str, str]) -> Iterator[str]:
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
            f"{kinds[frame.lidar]} 0 {_text([start, step * (scan.angles.size - 1), step, scan.range_max])} 0 0 "
            f"{_ranges(scan)} 0 {_text(laser)} {_text(frame.odometry)} {_text(twist)} 0 0 0 {_tail(frame)}"
        )


def _flaser_lines(path: Path, frames: Sequence[Frame], kinds: dict[str, str]) -> Iterator[str]:
    first = {frame.lidar: frame.scan for frame in reversed(frames) if frame.scan is not None}
    for name, kind in kinds.items():
        mount, range_max = first[name].mount, first[name].range_max
        if not same_mount(mount, (mount[0], 0.0, math.pi if kind == "RLASER" else 0.0)):
            raise LogError(f"{path}: {kind} has no place for a lidar mounted at {mount}: only for an offset along x")
        yield f"PARAM {OFFSETS[kind]} {mount[0]!r}"
        if math.isfinite(range_max):
            yield f"PARAM {MAXIMA[kind]} {range_max!r}"
    for index, frame in enumerate(frames):
        yield from _truth(frame)
        if frame.scan is None:
            yield _odom(frame)
            continue
        scan = frame.scan
        if not same_mount(scan.mount, first[frame.lidar].mount) or scan.range_max != first[frame.lidar].range_max:
            raise LogError(f"{path}: frame {index}: FLASER has no place for scans that differ in mount or range_max")
        _check_flaser_angles(path, index, scan)
        laser = se2.compose(frame.odometry, scan.mount)
        yield f"{kinds[frame.lidar]} {_ranges(scan)} {_text(laser)} {_text(frame.odometry)} {_tail(frame)}"


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
