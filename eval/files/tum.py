# SPDX-License-Identifier: MIT
"""Trajectories in the TUM format: one pose a line, `t x y z qx qy qz qw`, seconds and metres, `#` starts a comment.

Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats. Numbers are written so that reading them gives
the same float64 back. The plane is x, y: z is ignored on reading and written as 0.
"""

from __future__ import annotations

import os

import numpy as np

from eval.files.atomic_write import atomic_write
from eval.files.trajectory_file import TumError, read_trajectory
from eval.trajectory.trajectory import Trajectory

__all__ = ["TumError", "read_tum", "write_tum"]


def read_tum(path: str | os.PathLike[str]) -> Trajectory:
    """Read a trajectory as `eval.files.trajectory_file.read_trajectory` does, without its notes."""
    return read_trajectory(path)[0]


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
