# SPDX-License-Identifier: MIT
"""The table of a run: what it says of the particles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from testbed.frame import Frame
from testbed.run.step_table import BATCH, StepTable, spread_of
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


def test_another_best_particle_is_in_the_table_with_how_far_it_moves_the_pose() -> None:
    (first,) = snapshots(0.0, particles=5)
    *_, last = (s for s in snapshots(2.0, particles=5) if s.step is not None and s.step.proposed is not None)
    assert first.step is not None
    assert last.step is not None
    assert last.step.proposed is not None
    frame = Frame(stamp=0.0, odometry=np.zeros(3), scan=first.scan, truth=first.truth)
    best, weights, poses = last.step.best, np.full(5, 0.2), np.zeros((5, 3))
    other = (best + 1) % 5
    proposed = last.step.proposed.pose.copy()
    proposed[best], proposed[other] = (0.3, 0.4, 0.0), (0.0, 0.0, 1.0)
    step = replace(last.step, pose=proposed[best], proposed=last.step.proposed._replace(pose=proposed))
    table = StepTable()
    table.add(frame, first.step, 0.0, poses, weights, other)  # nothing is matched by the first scan
    table.add(frame, step, 0.0, poses, weights, best)  # another one was the best before
    table.add(frame, step, 0.0, poses, weights)  # the same one
    table.add(frame, step, 0.0, poses, weights)  # what was the best before is unknown
    np.testing.assert_allclose(table.columns()["best_moved_m"], [np.nan, 0.5, 0.0, np.nan])


def test_the_rows_of_a_long_run_are_packed_and_none_is_lost() -> None:
    (first,) = snapshots(0.0, particles=2)
    assert first.step is not None
    count, table = 2 * BATCH + 7, StepTable()
    assert table.columns() == {}
    for k in range(count):
        frame = Frame(stamp=0.1 * k, odometry=np.zeros(3), scan=first.scan, truth=np.array([0.01 * k, 0.0, 0.0]))
        table.add(frame, first.step, 0.0, np.zeros((2, 3)), np.full(2, 0.5))
        assert table.last_error == pytest.approx(0.01 * k)
        assert len(table._rows) < BATCH
    columns = table.columns()
    assert columns["scan"].tolist() == list(range(count))
    np.testing.assert_allclose(columns["stamp"], 0.1 * np.arange(count))
    np.testing.assert_allclose(columns["error_m"], 0.01 * np.arange(count), atol=1e-12)
    assert columns["updated"].dtype == bool
