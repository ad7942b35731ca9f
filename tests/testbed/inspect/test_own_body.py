# SPDX-License-Identifier: MIT
"""Beams at parts of the robot itself are taken as lost, and only those."""

import numpy as np
import pytest

from testbed.inspect.own_body import without_own_body
from tests.testbed.inspect.test_recording import drive, with_table
from tests.testbed.inspect.test_sweeps import path_error

POST = slice(100, 140)
"""Beams of an RPLidar A2 (800 beams) that a post hides."""


def with_readings(log, change):
    """The recording with other readings; `change` gets and changes those of all scans, (scans, beams)."""
    ranges = log.table.ranges.reshape(len(log.table.scan_rows), -1).copy()
    change(ranges)
    return with_table(log, ranges=ranges.reshape(-1))


def with_post(log, noise=0.01):
    def put(ranges):
        ranges[:, POST] = np.random.default_rng(0).normal(0.25, noise, ranges[:, POST].shape)

    return with_readings(log, put)


@pytest.mark.parametrize("world", ["office", "maze"])
def test_a_post_is_left_out_and_nothing_else(world):
    log = drive(world)
    found = without_own_body(with_post(log))
    (note,) = found.repairs
    assert note.startswith("40 beams of ")
    assert "(-135 to -117 deg) read the same" in note
    expected = log.table.ranges.reshape(len(log.table.scan_rows), -1).copy()
    expected[:, POST] = np.nan
    np.testing.assert_array_equal(found.table.ranges, expected.reshape(-1))


@pytest.mark.parametrize(("world", "lidar"), [("office", "rplidar_a2"), ("maze", "lds01"), ("apartment", "tim571")])
def test_a_recording_without_one_is_left_alone(world, lidar):
    log = drive(world, lidar=lidar)
    assert without_own_body(log) is log


def test_walls_at_the_side_of_a_robot_that_hardly_turns_are_left_alone():
    log = with_post(drive("office"))
    straight = log.table.odometry.copy()
    straight[:, 2] *= 0.02
    log = with_table(log, odometry=straight)
    assert without_own_body(log) is log


def test_readings_that_differ_by_heading_are_no_body():
    """A wall near by on one side of the room: half of the headings see it at the one distance, half at another."""
    log = drive("office")
    north = np.sin(log.table.odometry[log.table.scan_rows, 2]) > 0.0

    def put(ranges):
        ranges[:, POST] = np.where(north, 0.25, 0.4)[:, None]

    log = with_readings(log, put)
    assert without_own_body(log) is log


def test_a_lidar_that_has_stopped_is_no_body():
    def stop(ranges):
        ranges[:] = 0.5

    log = with_readings(drive("office"), stop)
    assert without_own_body(log) is log


@pytest.mark.slow
def test_the_path_is_that_of_the_recording_without_the_post():
    """In 40 s of office the error with the post's beams lost is that without the post."""
    log = drive("office")
    hidden = with_post(log)
    clean, found = (path_error(one) for one in (log, without_own_body(hidden)))
    assert found < 1.2 * clean
