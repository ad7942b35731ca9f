# SPDX-License-Identifier: MIT
"""Memory that the final pass takes for each end point, as arrays of numpy count it: the same on any machine."""

import tracemalloc

import numpy as np
import pytest

from slam._threads import Threads
from slam.config import RefineConfig
from slam.refinement import joint_equations
from slam.refinement.blind_stretches import blind_steps
from slam.refinement.bundle_adjustment import Adjustment
from slam.refinement.surfels import make_cloud
from slam.sensor.rays import make_rays
from tests.slam.rooms import drive, noisy_odometry, scan_at

SCANS, BEAMS = 400, 120


@pytest.fixture(scope="module")
def recording():
    """Poses, and the equations of a drive in which most end points are the only ones of their scan on their wall."""
    rng = np.random.default_rng(0)
    truth = drive(SCANS - 1, distance=0.1, turn=0.06)
    seen = [make_rays([scan_at(pose, beams=BEAMS, noise=0.01, rng=rng)], usable_range=20.0) for pose in truth]
    adjustment = Adjustment(
        noisy_odometry(truth, rng), make_cloud(seen, 10**6), np.arange(SCANS), RefineConfig(), Threads(1)
    )
    adjustment.step(truth, 0.1)  # kernels are compiled
    assert adjustment.solved.equations.observations.first[-1] > 0.8 * len(adjustment.cloud.ends)
    return truth, adjustment


def peak_of(call):
    """Largest number of bytes that are in use at once while a function runs, besides those before."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_round_needs_little_memory_for_an_end_point(recording):
    """End points in the map, their matches and what the noise is estimated from. The equations of the round before,
    which are forgotten first, are not counted."""
    truth, adjustment = recording
    assert peak_of(lambda: adjustment.step(truth, 0.1)) < 155 * len(adjustment.cloud.ends)


def test_blind_stretches_are_sought_a_part_of_the_equations_at_a_time(recording, monkeypatch):
    """What is kept follows from the scans, not from the blocks between scans and walls."""
    _, adjustment = recording
    monkeypatch.setattr(joint_equations, "OBSERVATIONS_AT_ONCE", 1000)
    equations, seen = adjustment.solved.equations, adjustment.seen
    assert peak_of(lambda: blind_steps(equations, seen)) < 20 * equations.observations.first[-1]
