# SPDX-License-Identifier: MIT
"""How long scoring takes.

python -m pytest -m benchmark -s tests/eval/test_speed.py
"""

import itertools
import time

import numpy as np
import pytest

from eval.map.grids import grid_from_true_map
from eval.map.lidar_view import LidarView
from eval.scoring import Reference, score
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.se2 import compose, inverse
from tests.eval.helpers import moved, noisy, random_walk
from tests.eval.synthetic_run import steps_of
from worlds import load, true_map

pytestmark = pytest.mark.benchmark


def ten_minutes() -> tuple[Trajectory, OccupancyGrid]:
    """6000 poses along the tour of the courtyard, and its true map in about 1000 x 1000 cells."""
    world = load("courtyard")
    points = np.asarray(world.path())[:, :2]
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, lengths[-1], 6000)
    x, y = (np.interp(at, lengths, points[:, axis]) for axis in (0, 1))
    heading = np.arctan2(np.gradient(y), np.gradient(x))
    return Trajectory(0.1 * np.arange(6000), np.column_stack([x, y, heading])), grid_from_true_map(
        true_map(world, 0.0425)
    )


def as_mapped(truth: OccupancyGrid) -> OccupancyGrid:
    """Walls three cells thick with holes, specks on the floor, probabilities of all sizes."""
    rng = np.random.default_rng(0)
    p = truth.probability.copy()
    for row, col in itertools.product((-1, 0, 1), repeat=2):
        p = np.fmax(p, np.where(rng.random(p.shape) < 0.7, np.roll(truth.probability, (row, col), (0, 1)), np.nan))
    p[rng.random(p.shape) < 0.002] = 1.0
    noise = rng.beta(1.2, 20.0, p.shape).astype(np.float32)
    return OccupancyGrid(
        probability=np.where(p > 0.5, 1.0 - noise, noise + 0.0 * p), resolution=truth.resolution, origin=truth.origin
    )


def test_all_measures_of_ten_minutes_on_a_large_map():
    truth, true = ten_minutes()
    assert min(true.probability.shape) > 900
    estimate, start = noisy(truth, 1, 0.02), truth.poses[0]
    there = Trajectory(estimate.stamps, compose(inverse(start), estimate.poses))
    steps = steps_of(truth.stamps, estimate.poses, truth.poses, np.random.default_rng(2))
    grid = moved(as_mapped(true), tuple(inverse(start)))
    lidar = LidarView(first=-2.36, width=4.72, range_max=12.0)
    started = time.process_time()  # a busy machine must not fail it
    metrics = score(
        there,
        reference=Reference(trajectory=truth, grid=true, lidars=(lidar,)),
        odometry=estimate,
        grid=grid,
        steps=steps,
    )
    seconds = time.process_time() - started
    print(f"\n10 min with {true.probability.shape} cells: {seconds:.2f} s")  # noqa: T201
    assert metrics["map"]["coverage"] > 0.9
    assert seconds < 3.0


def test_a_trajectory_of_100_000_poses_takes_less_than_1_s():
    truth = random_walk(100_000, 3)
    estimate = noisy(truth, 4)
    started = time.process_time()
    score(estimate, reference=Reference(trajectory=truth))
    seconds = time.process_time() - started
    print(f"\n100 000 poses: {seconds:.2f} s")  # noqa: T201
    assert seconds < 1.0
