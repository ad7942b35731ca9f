# SPDX-License-Identifier: MIT
"""Trajectories and places that the tests of eval share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from eval.trajectory import Trajectory
from slam.se2 import Pose, compose

ROOT = Path(__file__).resolve().parents[2]


def datasets() -> Path:
    """The folder of recorded logs; skips the test where it is absent."""
    folder = Path(os.environ.get("TESTBED_DATASETS") or ROOT.parent / "shared" / "datasets")
    if not (folder / "intel").is_dir():
        pytest.skip(f"recorded logs not found in {folder} (set TESTBED_DATASETS)")
    return folder


def random_walk(n: int, seed: int, *, step: float = 0.1) -> Trajectory:
    """A wandering robot: n poses 0.1 s apart."""
    rng = np.random.default_rng(seed)
    motions = np.column_stack(
        [rng.uniform(0.0, 2.0 * step, n), rng.normal(0.0, 0.1 * step, n), rng.normal(0.0, 0.2, n)]
    )
    return Trajectory(100.0 + 0.1 * np.arange(n), chain(motions))


def chain(motions: Pose) -> Pose:
    """Poses (n, 3) after each of the motions (n, 3), from the origin."""
    poses, pose = [], np.zeros(3)
    for motion in motions:
        pose = compose(pose, motion)
        poses.append(pose)
    return np.array(poses)


def noisy(trajectory: Trajectory, seed: int, sigma: float = 0.05) -> Trajectory:
    """The same path with independent noise on every pose [m and rad]."""
    rng = np.random.default_rng(seed)
    return Trajectory(trajectory.stamps, trajectory.poses + rng.normal(0.0, sigma, trajectory.poses.shape))
