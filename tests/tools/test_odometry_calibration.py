# SPDX-License-Identifier: MIT
"""The errors that the measurement of the calibration simulates, and what it says of them."""

from dataclasses import replace

import numpy as np
import pytest

import worlds
from slam import se2
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from tools.measure.odometry_calibration import MEANT, WRONG, Found, row


def test_the_corrections_that_are_meant_undo_the_simulated_errors():
    exact = replace(WRONG, random=False, ticks=False)
    config = SimulationConfig(backend="fast", seeds=RunSeeds.from_seed(0), duration=20.0, odometry=exact)
    with simulate(worlds.load("office"), config) as simulation:
        frames = list(simulation)
    odometry, truth = np.array([f.odometry for f in frames]), np.array([f.truth for f in frames])
    counted, driven = se2.between(odometry[:-1], odometry[1:]), se2.between(truth[:-1], truth[1:])
    turned = counted[:, 2] * (1.0 + MEANT[1]) + counted[:, 0] * MEANT[2]
    assert np.abs(driven[:, 2]).max() > 0.01
    np.testing.assert_allclose(counted[:, 0] * (1.0 + MEANT[0]), driven[:, 0], atol=1e-5)
    np.testing.assert_allclose(turned, driven[:, 2], atol=1e-5)


def test_a_row_has_root_mean_squares_and_stated_deviations():
    drives = [Found(np.array([0.003, 0.01, 0.001]), np.array([0.001, 0.02, 0.002]))]
    drives.append(Found(np.array([-0.004, -0.01, -0.001]), np.array([0.001, 0.02, 0.002])))
    assert row("hall", drives) == "| hall | 2 | 0.35 % (0.10) | 1.00 % (2.00) | 1.0 mrad/m (2.0) |"


def test_wheels_are_wrong_by_more_than_the_estimate_may_err():
    assert pytest.approx([-0.0196, 0.0309, -0.0101], abs=1e-4) == MEANT
