# SPDX-License-Identifier: MIT
"""Scans that are segments of a turn are told apart as lidars of their own; other scans are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.formats import Log
from testbed.formats.pose_interpolation import interpolate
from testbed.inspect.segments import with_segments_apart
from tests.testbed.inspect.test_recording import drive, with_table
from tests.testbed.inspect.test_sweeps import path_error


def in_segments(log, count):
    """The recording as of a lidar that sends each turn in so many scans, each stamped where it begins."""
    frames, table = [], log.table
    paths = table.odometry, table.truth
    for frame in log.table.frames():
        if frame.scan is None:
            frames.append(frame)
            continue
        scan, size = frame.scan, len(frame.scan.angles) // count
        for begin in range(0, size * count, size):
            part = slice(begin, begin + size)
            times = scan.time_offsets[part]
            cut = replace(
                scan, ranges=scan.ranges[part], angles=scan.angles[part], time_offsets=times - times[0],
                stamp=scan.stamp + times[0],
            )  # fmt: skip
            odometry, truth = (interpolate(table.stamps, poses, np.array([cut.stamp]))[0] for poses in paths)
            frames.append(replace(frame, stamp=cut.stamp, scan=cut, odometry=odometry, truth=truth))
    return Log.from_frames(frames, path=log.path, format=log.format)


@pytest.mark.parametrize("count", [2, 4])
def test_segments_are_told_apart(count):
    log = in_segments(drive("office"), count)
    found = with_segments_apart(log)
    assert found.table.lidars == tuple(f"laser_{k}" for k in range(1, count + 1))
    np.testing.assert_array_equal(found.table.scan_lidars, np.arange(len(log.table.scan_rows)) % count)
    (note,) = found.repairs
    assert f"look in {count} directions by turns" in note


def test_whole_turns_and_several_lidars_are_left_alone():
    log = drive("office")
    assert with_segments_apart(log) is log
    segments = with_segments_apart(in_segments(log, 2))
    assert with_segments_apart(segments) is segments


def test_views_that_overlap_are_no_segments():
    log = in_segments(drive("office"), 2)
    first, second = log.table.patterns[:2]
    wide = replace(second, angles=np.linspace(first.angles[-1] - 0.1, 3.0, second.angles.size))
    log = with_table(log, patterns=(first, wide, *log.table.patterns[2:]))
    assert with_segments_apart(log) is log


@pytest.mark.slow
def test_the_path_is_near_that_of_whole_turns():
    """In 40 s of office: 0.002 m with whole turns; lost with one segment at a time."""
    log = drive("office")
    segments = in_segments(log, 4)
    assert path_error(with_segments_apart(segments)) < 2.0 * path_error(log)
