# SPDX-License-Identifier: MIT
"""What is logged how often, in the run's time."""

from __future__ import annotations

import numpy as np
import pytest

from testbed.views.schedule import Schedule


@pytest.mark.parametrize(("rate", "expected"), [(5.0, 5.0), (10.0, 10.0), (40.0, 10.0)])
def test_poses_come_at_most_ten_times_a_second(rate: float, expected: float) -> None:
    schedule = Schedule()
    logged = sum(schedule.frame_due(k / rate, updated=False) for k in range(round(60 * rate)))
    assert logged / 60.0 == pytest.approx(expected, rel=0.03)


def test_a_scan_that_the_filter_took_in_is_always_logged() -> None:
    schedule = Schedule()
    assert all(schedule.frame_due(0.01 * k, updated=True) for k in range(50))


@pytest.mark.parametrize(("rate", "speed"), [(10.0, 0.3), (10.0, 2.0), (2.0, 0.5), (0.3, 0.5)])
def test_the_map_is_logged_before_it_is_a_second_or_half_a_metre_old(rate: float, speed: float) -> None:
    schedule, step = Schedule(), (1.0 / rate, speed / rate)
    logged = []
    for k in range(round(60 * rate)):
        if schedule.map_due(k / rate, k * step[1], step):
            schedule.map_was_logged(k / rate, k * step[1])
            logged.append(k)
    longest = float(np.max(np.diff(logged)))
    assert longest == 1 or longest / rate <= 1.0 + 1e-9
    assert longest == 1 or longest * step[1] <= 0.5 + 1e-9
    assert len(logged) < 60 * rate or rate <= 2.0  # not at every scan, where scans come often


def test_stamps_that_jump_back_do_not_stop_the_maps() -> None:
    schedule = Schedule()
    schedule.map_was_logged(900.0, 0.0)
    schedule.map_was_logged(1000.0, 5.0)
    assert not schedule.map_due(1000.1, 5.0, (0.1, 0.0))
    assert schedule.map_due(3.0, 5.0, (0.1, 0.0))


def test_particles_are_compared_every_ten_seconds_and_at_once_where_asked() -> None:
    schedule = Schedule()
    due = [stamp for stamp in np.arange(0.0, 60.0, 0.25) if schedule.comparison_due(stamp, at_once=stamp == 14.0)]
    assert 14.0 in due
    assert np.all(np.diff([stamp for stamp in due if stamp >= 14.0]) == pytest.approx(9.0, abs=0.26))


def test_particles_are_compared_less_often_in_a_log_with_few_scans() -> None:
    schedule = Schedule()
    due = [update for update in range(700) if schedule.comparison_due(3.0 * update, at_once=False)]
    assert due == [0, 200, 400, 600]


def test_a_jump_to_another_best_particle_is_compared_unless_scans_are_sparse() -> None:
    for period, expected in ((0.25, True), (3.0, False)):
        schedule = Schedule()
        due = [k for k in range(30) if schedule.comparison_due(period * k, at_once=False, jumped=k == 20)]
        assert (20 in due) is expected
