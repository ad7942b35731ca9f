# SPDX-License-Identifier: MIT
"""Writes rawlogs, the recordings that the programs of MRPT read: pairs of a motion and a scan.

MRPT's own converters are of no use here: that of CARMEN logs (2.5.8) drops the stamps, and marks readings as valid that
are none.

A rawlog is a gzip file of objects, each with its class, a version and its content, little-endian. Versions are old ones
that all releases since 1.3 read. Source: `serializeFrom` of the classes named here, https://github.com/MRPT/mrpt.
"""

from __future__ import annotations

import gzip
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slam import se2
from slam.scan import Scan
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.systems.even_beams import evenly_spaced

END = b"\x88"
"""Ends each object."""
TICKS_PER_SECOND = 10_000_000
EPOCH_TICKS = 11_644_473_600 * TICKS_PER_SECOND
"""1970-01-01 in ticks since 1601-01-01, which MRPT counts from."""
START = 1_000_000_000.0
"""Stamps count from here [s], since MRPT takes zero for none."""
MIN_STEP = 1e-3
"""Stamps increase by this at least [s]; those of recorded logs repeat and step back."""
FROM_ODOMETRY, GAUSSIAN = 0, 0
GAUSSIAN_MODEL = (0.01, np.rad2deg(0.001), np.deg2rad(1.0), 0.05, 0.01, np.deg2rad(0.2))
"""MRPT's default errors of a motion: a1 to a4, smallest standard deviations [m, rad]."""
SAMPLED_MODEL = (0.05, np.deg2rad(4.0), 0.01, np.rad2deg(0.0001), 0.001, np.deg2rad(0.05))
"""Those of its other model, which is not used: alpha 1 to 4, further standard deviations [m, rad]."""
MIN_BEAMS = 2


def write_rawlog(path: Path, frames: Sequence[Frame]) -> list[int]:
    """Write a pair of the motion since the last scan and a scan for each frame with beams; returns the frames' numbers.

    Raises ValueError where no frame has a scan with beams.
    """
    rows = [row for row, frame in enumerate(frames) if frame.scan is not None and len(frame.scan.angles) >= MIN_BEAMS]
    if not rows:
        raise ValueError(f"{path}: no scan with {MIN_BEAMS} beams or more, expected at least one")
    stamps = _increasing(np.array([frames[row].stamp for row in rows]))
    before = frames[rows[0]].odometry
    with gzip.open(path, "wb", compresslevel=1) as file:
        for row, stamp in zip(rows, stamps.tolist(), strict=True):
            frame = frames[row]
            assert frame.scan is not None
            ticks = EPOCH_TICKS + round((START + stamp) * TICKS_PER_SECOND)
            file.write(_collection("CActionCollection", 0, _motion(se2.between(before, frame.odometry), ticks)))
            file.write(_collection("CSensoryFrame", 2, _scan(frame.scan, frame.lidar, ticks)))
            before = frame.odometry
    return rows


def _increasing(stamps: np.ndarray) -> np.ndarray:
    """Stamps (n,) from the first on [s], each later than the one before."""
    steps = np.maximum(np.diff(stamps), MIN_STEP)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _object(name: str, version: int, content: bytes) -> bytes:
    return bytes([len(name) | 0x80]) + name.encode() + bytes([version]) + content + END


def _collection(name: str, version: int, item: bytes) -> bytes:
    return _object(f"mrpt::obs::{name}", version, struct.pack("<I", 1) + item)


def _motion(motion: Pose, ticks: int) -> bytes:
    """A motion (3,) by the odometry, with MRPT's default errors."""
    content = struct.pack("<I", FROM_ODOMETRY) + _object("mrpt::poses::CPose2D", 1, struct.pack("<3d", *motion))
    content += struct.pack("<I6f", GAUSSIAN, *GAUSSIAN_MODEL) + struct.pack("<I6f", 300, *SAMPLED_MODEL)
    no_velocity, no_encoders = struct.pack("<?2f", False, 0.0, 0.0), struct.pack("<?2i", False, 0, 0)
    return _object(
        "mrpt::obs::CActionRobotMovement2D", 6, content + no_velocity + no_encoders + struct.pack("<q", ticks)
    )


def _scan(scan: Scan, lidar: str, ticks: int) -> bytes:
    """A scan. Beams are evenly spaced about the forward axis of the sensor, so the sensor is turned to their middle."""
    beams, angles = evenly_spaced(scan)
    hit = scan.hit[beams]
    ranges = np.where(hit, scan.ranges[beams], scan.range_max)
    aperture = float(angles[-1] - angles[0])
    x, y, theta = se2.compose(np.asarray(scan.mount), np.array([0.0, 0.0, angles[0] + aperture / 2.0])).tolist()
    cos, sin = np.cos(theta), np.sin(theta)
    pose = (x, y, 0.0, cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)  # position, rotation matrix by rows
    content = struct.pack("<f?f", aperture, True, scan.range_max) + _object(
        "mrpt::poses::CPose3D", 3, struct.pack("<12d", *pose)
    )
    content += struct.pack("<I", len(ranges)) + ranges.astype("<f4").tobytes() + hit.astype(np.uint8).tobytes()
    noise, width, name = 0.01, np.deg2rad(0.25), lidar.encode()
    content += struct.pack("<fqf", noise, ticks, width) + struct.pack("<I", len(name)) + name
    return _object("mrpt::obs::CObservation2DRangeScan", 7, content + struct.pack("<d?", 0.0, False))
