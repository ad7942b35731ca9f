# SPDX-License-Identifier: MIT
"""The loops of a simulated run are those that the robot drove."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import worlds
from eval.filter.health import filter_health
from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.seeds import RunSeeds
from testbed.settings.simulator import SIMULATOR
from testbed.simulation import simulate


def test_the_largest_loop_of_the_office_is_the_way_around_its_core() -> None:
    """By the truth the robot is back within a metre of an old place after 56 m of driving, at 134 s."""
    seeds = RunSeeds.from_seed(0)
    estimation = Estimation(FilterConfig(particles=2), seeds.filter, threads=1)
    frames = []
    with simulate(worlds.load("office"), replace(SIMULATOR.simulation(seeds), backend="fast")) as simulation:
        for frame in simulation:
            estimation.process(frame)
            frames.append(frame)
    truth = np.array([frame.truth for frame in frames])
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    loops = []
    for row in range(0, len(truth), 10):
        near = np.hypot(*(truth[:row, :2] - truth[row, :2]).T) < 1.0
        old = np.flatnonzero(near & (path[row] - path[:row] > 15.0))
        loops.append(path[row] - path[old[-1]] if len(old) else 0.0)
    first = int(np.argmax(np.array(loops) > 0.0))
    health = filter_health(estimation.steps.columns())
    assert health is not None
    assert health.largest_loop_m == pytest.approx(loops[first], rel=0.1)
    assert health.largest_loop_stamp == pytest.approx(frames[10 * first].stamp, abs=3.0)
