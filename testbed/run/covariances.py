# SPDX-License-Identifier: MIT
"""The covariances of the final poses: the file `estimate_covariance.parquet` and the group `covariance` of metrics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.consistency import LEVEL, chi_square, path_nees
from eval.files.atomic_write import atomic_write
from eval.metrics_json import Metrics
from eval.trajectory.trajectory import Trajectory
from slam.se2 import Pose

ENTRIES = {"xx": (0, 0), "xy": (0, 1), "yy": (1, 1), "xt": (0, 2), "yt": (1, 2), "tt": (2, 2)}
"""Columns `cov_…` [m^2, m rad, rad^2] and their places, as in `steps.parquet`."""


def write_covariances(path: Path, at_scans: Trajectory, covariances: NDArray[np.float64]) -> None:
    """Write the covariances (scans, 3, 3) of the poses in `estimate.tum`, a row each."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {"stamp": at_scans.stamps, **{f"cov_{name}": covariances[:, *at] for name, at in ENTRIES.items()}}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        pq.write_table(pa.table(columns), file)


def covariance_metrics(covariances: NDArray[np.float64], poses: Pose, truth: list[Pose | None]) -> Metrics:
    """Return how uncertain the poses of all frames are, and, where the truth is known, whether that is right.

    covariances (frames, 3, 3);  poses (frames, 3);  truth: that of each frame or None
    """
    largest = np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1]
    heading = covariances[:, 2, 2]
    found: Metrics = {
        "sigma_position_max_m": float(np.sqrt(max(largest.max(), 0.0))),
        "sigma_heading_max_deg": float(np.degrees(np.sqrt(heading.max()))),
    }
    known = [i for i, pose in enumerate(truth) if pose is not None]
    if not known or known[0] != 0:  # the covariances are relative to the first pose
        return found
    nees = path_nees(poses[known], np.array([truth[i] for i in known]), covariances[known])
    nees = nees[np.isfinite(nees)]
    if len(nees):
        found |= {"nees_mean": float(nees.mean()), "inside_95_share": float(np.mean(nees <= chi_square(LEVEL, 3)))}
    return found
