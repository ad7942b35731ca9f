# SPDX-License-Identifier: MIT
"""Speed limits in front of obstacles."""

import numpy as np
import pytest

from testbed.exploration.collision_limiter import CLEARANCE_AHEAD, LATENCY, CollisionLimiter
from testbed.presets import load_robot
from testbed.simulation import DriverConfig

ROBOT, CONFIG = load_robot("create3"), DriverConfig()


@pytest.mark.parametrize("distance", [0.4, 0.6, 1.0, 2.0])
def test_the_limiter_lets_the_robot_stop_before_obstacles(distance):
    limiter = CollisionLimiter(ROBOT, CONFIG)
    obstacle = np.array([[distance, 0.05], [-0.3, 0.0], [0.5, 1.0]])
    room = distance - ROBOT.footprint_radius - CLEARANCE_AHEAD
    assert limiter.room_ahead(obstacle) == pytest.approx(room, abs=0.02)
    speed = limiter.limited(5.0, obstacle)
    braking = min(CONFIG.acceleration, ROBOT.max_acceleration)
    assert speed * LATENCY + speed**2 / (2.0 * braking) == pytest.approx(max(room, 0.0), abs=0.02)
    assert limiter.limited(-0.1, obstacle) == -0.1
    assert limiter.limited(0.3, np.array([[1.0, 1.0], [-0.2, 0.0]])) == 0.3
