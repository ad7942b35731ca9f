# SPDX-License-Identifier: MIT
"""Trajectories in the TUM format: one pose a line, `t x y z qx qy qz qw`, seconds and metres, `#` starts a comment.

Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats. Numbers are written so that reading them gives
the same float64 back. The plane is x, y: z is ignored on reading and written as 0.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from eval.files.atomic_write import atomic_write
from eval.trajectory.trajectory import Trajectory
from slam.se2 import wrap_angle

NORM_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from 1 (files with 4 digits); such a quaternion is normalised."""
TILT_TOLERANCE = np.radians(1.0)
"""Largest tilt of a pose out of the plane [rad]; such a pose is projected onto the plane."""


class TumError(ValueError):
    """A file that is not a planar TUM trajectory; the message names file, line and what was expected."""


def read_tum(path: str | os.PathLike[str]) -> Trajectory:
    """Read a TUM file in file order: stamps may repeat and step backwards.

    Raises TumError for a wrong count of columns, what is not a finite number, a quaternion that is no unit (beyond
    `NORM_TOLERANCE`), a pose out of the plane (beyond `TILT_TOLERANCE`), or no pose at all; OSError as `open` does.
    """
    path = Path(path)
    lines, rows = [], []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            fields = line.partition("#")[0].replace(",", " ").split()
            if not fields:
                continue
            if len(fields) != 8:
                raise TumError(f"{path}:{number}: expected 8 numbers 't x y z qx qy qz qw', got {len(fields)}")
            try:
                rows.append([float(field) for field in fields])
            except ValueError:
                raise TumError(f"{path}:{number}: expected 8 numbers, got '{line.strip()[:80]}'") from None
            lines.append(number)
    if not rows:
        raise TumError(f"{path}: expected poses 't x y z qx qy qz qw', found none")
    table = np.array(rows)

    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(bad):
        raise TumError(f"{path}:{lines[bad[0]]}: expected finite numbers, got NaN or infinity")
    norm = np.linalg.norm(table[:, 4:], axis=1)
    bad = np.flatnonzero(np.abs(norm - 1.0) > NORM_TOLERANCE)
    if len(bad):
        raise TumError(
            f"{path}:{lines[bad[0]]}: expected a unit quaternion qx qy qz qw, got one of length {norm[bad[0]]:.4g}"
        )
    qx, qy, qz, qw = (table[:, 4:] / norm[:, None]).T
    tilt = 2.0 * np.arcsin(np.minimum(np.hypot(qx, qy), 1.0))  # angle between the two z axes
    bad = np.flatnonzero(tilt > TILT_TOLERANCE)
    if len(bad):
        raise TumError(
            f"{path}:{lines[bad[0]]}: expected a pose in the plane (qx = qy = 0), got one that leans by "
            f"{np.degrees(tilt[bad[0]]):.1f} degrees"
        )
    return Trajectory(table[:, 0], np.column_stack([table[:, 1], table[:, 2], wrap_angle(2.0 * np.arctan2(qz, qw))]))


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write a TUM file whole, in the trajectory's order, with all digits of float64."""
    half = 0.5 * trajectory.poses[:, 2]
    rows = zip(
        trajectory.stamps.tolist(),
        trajectory.poses[:, 0].tolist(),
        trajectory.poses[:, 1].tolist(),
        np.sin(half).tolist(),
        np.cos(half).tolist(),
        strict=True,
    )
    text = "".join(f"{t!r} {x!r} {y!r} 0 0 0 {qz!r} {qw!r}\n" for t, x, y, qz, qw in rows)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
