# SPDX-License-Identifier: MIT
"""Trajectories and places that the tests of eval share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
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


def room(*, resolution: float = 0.05, width: float = 6.0, height: float = 4.0, margin: float = 1.0) -> OccupancyGrid:
    """A true map: an empty room with walls one cell thick, unknown outside; its inner corner is at (0, 0)."""
    cols, rows, border = (round(length / resolution) for length in (width, height, margin))
    probability = np.full((rows + 2 * border, cols + 2 * border), np.nan, dtype=np.float32)
    probability[border - 1 : border + rows + 1, border - 1 : border + cols + 1] = 1.0
    probability[border : border + rows, border : border + cols] = 0.0
    return OccupancyGrid(probability=probability, resolution=resolution, origin=(-margin, -margin, 0.0))


def with_wall(grid: OccupancyGrid, rows: slice | int, cols: slice | int, value: float = 1.0) -> OccupancyGrid:
    """A copy with some cells set to `value`."""
    probability = grid.probability.copy()
    probability[rows, cols] = value
    return OccupancyGrid(probability=probability, resolution=grid.resolution, origin=grid.origin)


def moved(grid: OccupancyGrid, T: tuple[float, float, float]) -> OccupancyGrid:
    """The same cells with the whole map moved by T."""
    x, y, theta = compose(T, grid.origin)
    return OccupancyGrid(
        probability=grid.probability, resolution=grid.resolution, origin=(float(x), float(y), float(theta))
    )
