# SPDX-License-Identifier: MIT
"""The estimate that explorers steer by."""

import dataclasses
import math

import numpy as np

from slam import se2
from slam.sensor.deskew import exp_twist
from tests.testbed.exploration.hand_drawn_maps import belief, scan_of


def test_obstacles_are_in_the_robot_frame():
    scan = dataclasses.replace(scan_of([np.inf, np.inf, 2.0, np.inf]), mount=(0.5, 0.0, math.pi / 2.0))
    both = belief(None, (0, 0, 0), scans=(scan, scan_of([np.inf, np.inf, 1.0, np.inf])))
    np.testing.assert_allclose(both.obstacles(), [[0.5, 2.0], [1.0, 0.0]], atol=1e-12)


def test_the_motion_since_the_scan_is_undone():
    """Each beam sees the same fixed point from where the robot was then; now the robot is elsewhere."""
    twist, point, n = np.array([0.4, 0.0, 1.0]), np.array([1.5, 0.4]), 40
    offsets = np.linspace(0.0, 0.1, n)
    seen = [se2.transform_points(se2.inverse(exp_twist(twist, t)), point[None])[0] for t in offsets]
    scan = dataclasses.replace(
        scan_of([np.hypot(*p) for p in seen]),
        angles=np.array([math.atan2(p[1], p[0]) for p in seen]),
        stamp=5.0,
        time_offsets=offsets,
    )
    known = dataclasses.replace(belief(None, (0, 0, 0), stamp=5.25, scans=(scan,)), twist=twist)
    expected = se2.transform_points(se2.inverse(exp_twist(twist, 0.25)), point[None])[0]
    np.testing.assert_allclose(known.obstacles(), np.tile(expected, (n, 1)), atol=1e-9)
    ignored = dataclasses.replace(known, twist=None).obstacles()
    assert np.hypot(*(ignored - expected).T).max() > 0.1
