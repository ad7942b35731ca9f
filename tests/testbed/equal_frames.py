# SPDX-License-Identifier: MIT
"""Comparison of frames to the last bit."""

import numpy as np

from testbed.frame import Frame


def assert_equal_frames(read: list[Frame], written: list[Frame]) -> None:
    """Raise AssertionError unless all frames are equal in everything that they hold."""
    assert len(read) == len(written)
    for got, put in zip(read, written, strict=True):
        assert (got.stamp, got.command, got.lidar) == (put.stamp, put.command, put.lidar)
        for name in ("odometry", "twist", "truth"):
            assert (getattr(got, name) is None) == (getattr(put, name) is None)
            if getattr(put, name) is not None:
                np.testing.assert_array_equal(getattr(got, name), getattr(put, name))
        assert (got.scan is None) == (put.scan is None)
        if put.scan is not None:
            for name in ("ranges", "angles", "time_offsets", "mount", "range_min", "range_max", "stamp"):
                np.testing.assert_array_equal(getattr(got.scan, name), getattr(put.scan, name))
