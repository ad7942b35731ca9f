# SPDX-License-Identifier: MIT
"""What is logged how often, in the run's time."""

from __future__ import annotations

import numpy as np
import pytest

from testbed.views.schedule import MAP_BYTES_PER_SECOND, MAP_SHARE, Schedule


@pytest.mark.parametrize(("rate", "expected"), [(5.0, 5.0), (10.0, 10.0), (40.0, 10.0)])
def test_poses_come_at_most_ten_times_a_second(rate: float, expected: float) -> None:
    schedule = Schedule()
    logged = sum(schedule.frame_due(k / rate, updated=False) for k in range(round(60 * rate)))
    assert logged / 60.0 == pytest.approx(expected, rel=0.03)


def test_a_scan_that_the_filter_took_in_is_always_logged() -> None:
    schedule = Schedule()
    assert all(schedule.frame_due(0.01 * k, updated=True) for k in range(50))


@pytest.mark.parametrize("cells", [10_000, 4 * MAP_BYTES_PER_SECOND])
def test_maps_come_once_a_second_but_never_faster_than_their_bytes_allow(cells: int) -> None:
    schedule = Schedule()
    stamps = [t for t in np.arange(0.0, 100.0, 0.1) if schedule.map_due(t, resampled=False)
              and schedule.map_was_logged(t, cells, 0.0) is None]  # fmt: skip
    assert np.mean(np.diff(stamps)) == pytest.approx(max(1.0, cells / MAP_BYTES_PER_SECOND), rel=0.15)
    half = 0.5 * max(1.0, cells / MAP_BYTES_PER_SECOND)
    assert schedule.map_due(stamps[-1] + half, resampled=True)
    assert not schedule.map_due(stamps[-1] + 0.8 * half, resampled=True)


def test_stamps_that_jump_back_do_not_stop_the_maps() -> None:
    schedule = Schedule()
    schedule.map_was_logged(1000.0, 1, 0.0)
    assert not schedule.map_due(1000.5, resampled=False)
    assert schedule.map_due(3.0, resampled=False)


def test_maps_take_no_more_than_their_share_of_the_wall_time_however_fast_the_run() -> None:
    now, spent = 0.0, 0.0
    schedule = Schedule(clock=lambda: now)
    for k in range(2000):
        now += 0.01
        if schedule.map_due(3.0 * k, resampled=k % 2 == 0):  # 300 times as fast as the robot
            now, spent = now + 0.02, spent + 0.02
            schedule.map_was_logged(3.0 * k, 1, 0.02)
    assert spent / now == pytest.approx(MAP_SHARE, rel=0.1)
