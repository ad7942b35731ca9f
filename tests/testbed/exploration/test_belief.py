# SPDX-License-Identifier: MIT
"""The estimate that explorers steer by."""

import dataclasses
import math

import numpy as np

from tests.testbed.exploration.hand_drawn_maps import belief, scan_of


def test_obstacles_are_in_the_robot_frame():
    scan = dataclasses.replace(scan_of([np.inf, np.inf, 2.0, np.inf]), mount=(0.5, 0.0, math.pi / 2.0))
    both = belief(None, (0, 0, 0), scans=(scan, scan_of([np.inf, np.inf, 1.0, np.inf])))
    np.testing.assert_allclose(both.obstacles(), [[0.5, 2.0], [1.0, 0.0]], atol=1e-12)
