# SPDX-License-Identifier: MIT
"""Times of beams that a recording does not state: found where a lidar turns without a pause, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.inspect.sweeps import with_beam_times
from tests.testbed.estimation.test_starting_path import error_of
from tests.testbed.inspect.test_recording import drive, with_table


def timeless(log, *, backward=False):
    """The recording without times of its beams; backward: with its beams in the other order."""
    table = log.table
    turned = slice(None, None, -1 if backward else 1)
    patterns = tuple(replace(p, angles=p.angles[turned], time_offsets=None) for p in table.patterns)
    ranges = table.ranges.reshape(len(table.scan_rows), -1)[:, turned].reshape(-1)
    return with_table(log, patterns=patterns, ranges=ranges)


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("world", ["office", "warehouse"])
def test_times_are_found_in_either_order(world, backward):
    log = drive(world)
    found = with_beam_times(timeless(log, backward=backward))
    (note,) = found.repairs
    assert note.endswith("with the last beam") == backward
    (number,) = set(found.table.scan_patterns.tolist())
    np.testing.assert_allclose(found.table.patterns[number].time_offsets, log.table.patterns[0].time_offsets, atol=1e-9)
    np.testing.assert_array_equal(found.table.patterns[number].angles, log.table.patterns[0].angles)
    np.testing.assert_array_equal(found.table.ranges, log.table.ranges)


def test_scans_taken_at_once_are_left_alone():
    """Beams that look where they would look if the robot had not moved since the stamp."""
    log = timeless(drive("office"))
    table, half = log.table, log.table.patterns[0].angles.size // 2
    at_once = with_table(log, patterns=(replace(table.patterns[0], angles=np.roll(table.patterns[0].angles, half)),))
    ranges = table.ranges.reshape(len(table.scan_rows), -1)
    whole = with_table(at_once, ranges=np.roll(ranges, half, axis=1).reshape(-1))  # the jump is in the middle
    assert with_beam_times(whole) is whole


def test_stated_times_half_turns_and_robots_at_rest_are_left_alone():
    log = drive("office")
    assert with_beam_times(log) is log
    bare = timeless(log)
    rest = with_table(bare, odometry=np.zeros_like(log.table.odometry))
    assert with_beam_times(rest) is rest
    slow = with_table(bare, stamps=10.0 * log.table.stamps)
    assert with_beam_times(slow) is slow


@pytest.mark.slow
def test_the_path_is_that_of_the_recording_with_its_times():
    """In 40 s of office the error is 0.002 m with the times, stated or found, and 0.022 m without."""
    log = drive("office")
    bare = timeless(log)
    stated, found, none = (path_error(one) for one in (log, with_beam_times(bare), bare))
    assert found < 1.2 * stated
    assert none > 5.0 * stated


def path_error(log):
    """Error of the path after the final pass [m]."""
    estimation = Estimation(FilterConfig(particles=10), 1)
    for frame in log.table.frames():
        estimation.process(frame)
    return error_of(estimation, estimation.refined(estimation.filtered()).dense.poses)
