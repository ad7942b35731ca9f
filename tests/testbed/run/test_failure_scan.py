# SPDX-License-Identifier: MIT
"""The scan that shows a failure lies on the true walls, whatever the wheels said."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from slam.scan import Scan
from slam.se2 import transform_points
from slam.sensor.deskew import exp_twist, log_twist
from slam.sensor.rays import make_rays
from testbed.frame import Frame
from testbed.run.execute import true_twist

SPEED, TURN = 0.4, 1.5
"""[m/s], [rad/s]"""
BEAMS, SWEEP = 180, 0.1
"""Beams of a scan, and the time from the first to the last [s]."""


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(0.05, 2.0))
def test_log_twist_is_the_inverse_of_exp_twist(vx: float, vy: float, omega: float, seconds: float) -> None:
    twist = np.array([vx, vy, omega])
    np.testing.assert_allclose(log_twist(exp_twist(twist, seconds), seconds), twist, atol=1e-9)


def turning_robot() -> list[Frame]:
    """A robot that turns on a curve in a square room of 6 m; each beam is measured from where the robot is then."""
    frames = []
    for k in range(20):
        stamp = 0.05 * k
        offsets = np.linspace(0.0, SWEEP, BEAMS)
        angles = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
        poses = exp_twist([SPEED, 0.0, TURN], stamp + offsets)
        directions = poses[:, 2] + angles
        with np.errstate(divide="ignore"):
            to_x = (3.0 * np.sign(np.cos(directions)) - poses[:, 0]) / np.cos(directions)
            to_y = (3.0 * np.sign(np.sin(directions)) - poses[:, 1]) / np.sin(directions)
        scan = Scan(ranges=np.minimum(to_x, to_y), angles=angles, range_max=20.0, stamp=stamp, time_offsets=offsets)
        truth = exp_twist([SPEED, 0.0, TURN], stamp)
        slipping = np.array([SPEED, 0.0, -0.5 * TURN])
        frames.append(Frame(stamp=stamp, odometry=truth, scan=scan, twist=slipping, truth=truth))
    return frames


def off_the_walls(frame: Frame, twist: np.ndarray | None) -> float:
    """Largest distance of the scan's ends from the walls, drawn from the true pose [m]."""
    assert frame.scan is not None
    assert frame.truth is not None
    ends = transform_points(frame.truth, make_rays([frame.scan], usable_range=20.0, twist=twist).ends)
    return float(np.abs(np.abs(ends).max(axis=1) - 3.0).max())


def test_the_scan_drawn_from_the_true_pose_lies_on_the_true_walls() -> None:
    frames = turning_robot()
    twist = true_twist(frames, 8)
    assert twist is not None
    np.testing.assert_allclose(twist, [SPEED, 0.0, TURN], atol=1e-9)
    assert off_the_walls(frames[8], twist) < 1e-6
    assert off_the_walls(frames[8], frames[8].twist) > 0.2  # as the slipping wheels would have it


def test_without_truth_there_is_no_true_twist() -> None:
    frames = [Frame(stamp=f.stamp, odometry=f.odometry, scan=f.scan) for f in turning_robot()]
    assert true_twist(frames, 3) is None
    assert true_twist(turning_robot(), 19) is None  # nothing comes after the last frame
