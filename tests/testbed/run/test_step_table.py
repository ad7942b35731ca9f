# SPDX-License-Identifier: MIT
"""The table of a run: what it says of the particles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from testbed.frame import Frame
from testbed.run.step_table import StepTable, spread_of
from tests.testbed.views.synthetic import snapshots


def test_the_spread_is_the_deviation_of_the_weighted_positions() -> None:
    poses = np.array([[0.0, 0.0, 5.0], [3.0, 4.0, -5.0], [9.0, 9.0, 0.0]])
    assert spread_of(poses, np.array([0.5, 0.5, 0.0])) == pytest.approx(2.5)
    assert spread_of(poses[:1], np.ones(1)) == 0.0
    assert np.isnan(spread_of(poses[:0], np.ones(0)))
    rng = np.random.default_rng(0)
    cloud = rng.normal([1e3, -1e3, 0.0], [0.3, 0.4, 1.0], (100_000, 3))
    assert spread_of(cloud, np.full(100_000, 1e-5)) == pytest.approx(0.5, rel=0.01)


def test_particles_without_a_descendant_have_died() -> None:
    (first,) = snapshots(0.0, particles=5)
    assert first.step is not None
    frame = Frame(stamp=0.0, odometry=np.zeros(3), scan=first.scan, truth=first.truth)
    poses = np.array([[k, 0.0, 0.0] for k in (0, 0, 3, 3, 3)], float)
    table = StepTable()
    for resampled in (True, False):
        table.add(frame, replace(first.step, resampled=resampled), 0.0, poses, np.full(5, 0.2))
    table.add(frame, replace(first.step, updated=False), 0.0, poses, np.full(5, 0.2))
    assert table.columns()["particles_died"].tolist() == [3, 0, 0]
    spreads = table.columns()["spread_m"]
    assert spreads[0] == pytest.approx(np.std([0, 0, 3, 3, 3]))
    assert np.isnan(spreads[2])
