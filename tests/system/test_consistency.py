# SPDX-License-Identifier: MIT
"""The filter's covariance against the error that it really made, over seeds (docs/consistency.md)."""

import numpy as np
import pytest

import worlds
from eval.consistency import LEVEL, chi_square
from eval.filter.nees import nees
from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, OdometryConfig, SimulationConfig, simulate

SEEDS = 6


def mean_nees(seed: int) -> float:
    """Of a short drive through the office with exact sensors."""
    seeds = RunSeeds.from_seed(seed)
    config = SimulationConfig(
        backend="fast",
        seeds=seeds,
        duration=8.0,
        lidar_layers=LidarLayers.none(),
        odometry=OdometryConfig(systematic=False, random=False, ticks=False),
    )
    estimation = Estimation(FilterConfig(), seeds.filter)
    with simulate(worlds.load("office"), config) as simulation:
        for frame in simulation:
            estimation.process(frame)
    return float(nees(estimation.steps.columns())[1].mean())


@pytest.mark.slow
def test_with_exact_sensors_the_filter_is_not_too_sure_of_itself():
    """The mean NEES lies below the upper end of the 95 % band of as many independent runs, and well above zero: a
    covariance that claims nothing would pass the first alone."""
    mean = np.mean([mean_nees(seed) for seed in range(SEEDS)])
    assert 0.5 < mean < chi_square((1.0 + LEVEL) / 2.0, 3 * SEEDS) / SEEDS
