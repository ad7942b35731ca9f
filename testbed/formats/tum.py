# SPDX-License-Identifier: MIT
"""Trajectories of a recording in the TUM format: odometry, and truth where it is known. No scans."""

from __future__ import annotations

from pathlib import Path

from eval.files.tum import TumError, read_tum, write_tum
from eval.trajectory.trajectory import Trajectory
from testbed.formats.checksums import verify
from testbed.formats.log import Log, LogError
from testbed.frame import Frame

ODOMETRY, TRUTH = "odometry.tum", "truth.tum"


def write_trajectories(path: str | Path, log: Log) -> None:
    """Write a directory `path`, which must not exist yet, with odometry.tum and, where it is known, truth.tum."""
    path = Path(path)
    path.mkdir(parents=True)
    for name, poses in ((ODOMETRY, log.table.odometry), (TRUTH, log.table.truth)):
        known = log.table.known(poses)
        if known.any():
            write_tum(path / name, Trajectory(log.table.stamps[known], poses[known]))


def read_trajectories(path: Path) -> Log:
    """Frames without scans, from one TUM file as odometry, or from what `write_trajectories` wrote.

    Raises LogError, naming the file and the line, for what is no such trajectory, and where the truth has stamps that
    the odometry has not.
    """
    if path.is_dir():
        verify(path)
    try:
        odometry = read_tum(path / ODOMETRY if path.is_dir() else path)
        truth = read_tum(path / TRUTH) if path.is_dir() and (path / TRUTH).is_file() else None
    except TumError as error:
        raise LogError(str(error)) from None
    true_poses = {} if truth is None else dict(zip(truth.stamps.tolist(), truth.poses, strict=True))
    if strange := sorted(true_poses.keys() - set(odometry.stamps.tolist())):
        raise LogError(f"{path / TRUTH}: a pose at {strange[0]!r} s, where {ODOMETRY} has none")
    frames = [
        Frame(stamp=stamp, odometry=pose, truth=true_poses.get(stamp))
        for stamp, pose in zip(odometry.stamps.tolist(), odometry.poses, strict=True)
    ]
    return Log.from_frames(frames, path=path, format="TUM trajectory")
