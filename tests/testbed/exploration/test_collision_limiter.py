# SPDX-License-Identifier: MIT
"""Speed limits in front of obstacles: whatever is allowed can be braked without touching anything."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.exploration import Belief
from testbed.exploration.collision_limiter import CLEARANCE, CLEARANCE_AHEAD, LATENCY, CollisionLimiter
from testbed.presets import load_robot
from testbed.simulation import DriverConfig
from tests.testbed.exploration.hand_drawn_maps import scan_of

ROBOT, CONFIG = load_robot("create3"), DriverConfig()
LIMITER = CollisionLimiter(ROBOT, CONFIG)
RADIUS = ROBOT.footprint_radius
BRAKING = min(CONFIG.acceleration, ROBOT.max_acceleration)
TURNING = min(CONFIG.turn_acceleration, ROBOT.max_turn_acceleration)


class Sees(Belief):
    """An estimate whose last scan shows these points [m]."""

    def __init__(self, obstacles, twist=None):
        super().__init__(stamp=0.0, pose=np.zeros(3), scans=(scan_of(),), twist=twist, map=lambda: None)
        object.__setattr__(self, "points", np.array(obstacles, dtype=float).reshape(-1, 2))

    def obstacles(self):
        return self.points


def nearest_while_braking(speed, turn_rate, twist, obstacles):
    """Least distance of the robot's centre from each obstacle, integrated in steps of 1 ms."""
    now = max(abs(speed), abs(twist[0]) if twist[0] * speed > 0.0 else 0.0)
    x = y = theta = time = 0.0
    least = np.hypot(*obstacles.T)
    while now > 0.0:
        time += 0.001
        turn = twist[2] + min(max(turn_rate - twist[2], -TURNING * time), TURNING * time)
        theta += turn * 0.001
        x, y = (
            x + math.copysign(now, speed) * math.cos(theta) * 0.001,
            y + math.copysign(now, speed) * math.sin(theta) * 0.001,
        )
        if time > LATENCY:
            now -= BRAKING * 0.001
        least = np.minimum(least, np.hypot(*(obstacles - [x, y]).T))
    return least


@given(
    st.floats(-0.45, 0.45), st.floats(-1.5, 1.5), st.floats(0.0, 0.45), st.floats(-1.5, 1.5), st.integers(0, 2**32 - 1)
)
@settings(max_examples=150, deadline=None)
def test_an_allowed_speed_can_be_braked_without_contact(speed, turn_rate, forward, turning, seed):
    rng = np.random.default_rng(seed)
    angles, away = rng.uniform(-np.pi, np.pi, 30), rng.uniform(RADIUS + 0.005, 1.2, 30)
    obstacles = np.column_stack([away * np.cos(angles), away * np.sin(angles)])
    twist = np.array([math.copysign(forward, speed), 0.0, turning])
    allowed = LIMITER.limited(speed, turn_rate, Sees(obstacles, twist))
    assert abs(allowed) <= abs(speed)
    assert allowed * speed >= 0.0
    if allowed != 0.0:
        kept = np.minimum(RADIUS + CLEARANCE, away)
        assert (nearest_while_braking(allowed, turn_rate, twist, obstacles) >= kept - 0.006).all()


@pytest.mark.parametrize("distance", [0.3, 0.4, 0.6, 1.0, 2.0])
@pytest.mark.parametrize("forward", [1.0, -1.0])
def test_the_limiter_uses_the_room_that_there_is(distance, forward):
    room = max(distance - RADIUS - CLEARANCE, 0.0)
    speed = LIMITER.limited(forward, 0.0, Sees([[forward * distance, 0.0]], np.zeros(3)))
    assert abs(speed) * LATENCY + speed**2 / (2.0 * BRAKING) <= room + 0.003
    faster = min(abs(speed) + 0.11, 1.0)
    assert speed == forward or faster * LATENCY + faster**2 / (2.0 * BRAKING) > room


def test_a_wall_that_is_passed_does_not_slow_the_robot_down():
    wall = np.column_stack([np.linspace(-1.0, 1.0, 81), np.full(81, RADIUS + 0.03)])
    assert LIMITER.limited(0.4, 0.0, Sees(wall, np.array([0.4, 0.0, 0.0]))) == 0.4


def test_a_turn_towards_a_wall_at_the_side_slows_the_robot_down():
    wall = np.column_stack([np.linspace(-1.0, 1.0, 81), np.full(81, RADIUS + 0.03)])
    assert LIMITER.limited(0.4, 1.0, Sees(wall, np.array([0.4, 0.0, 0.0]))) < 0.4
    assert LIMITER.limited(0.4, 0.0, Sees(wall, np.array([0.4, 0.0, 1.0]))) < 0.4  # it still turns
    assert LIMITER.limited(0.4, -1.0, Sees(wall, np.array([0.4, 0.0, 0.0]))) == 0.4


def test_the_present_speed_counts_as_well():
    ahead = [[RADIUS + CLEARANCE + 0.1, 0.0]]
    assert LIMITER.limited(0.1, 0.0, Sees(ahead, np.zeros(3))) == pytest.approx(0.1)
    assert LIMITER.limited(0.1, 0.0, Sees(ahead, np.array([0.4, 0.0, 0.0]))) == 0.0


def test_a_robot_in_contact_may_leave():
    touching = [[RADIUS - 0.005, 0.0]]
    assert LIMITER.limited(0.1, 0.0, Sees(touching, np.zeros(3))) == 0.0
    assert LIMITER.limited(-0.1, 0.0, Sees(touching, np.zeros(3))) == -0.1


@pytest.mark.parametrize("distance", [0.4, 1.0])
def test_room_ahead_is_that_of_the_footprint(distance):
    obstacles = np.array([[distance, 0.05], [-0.3, 0.0], [0.5, 1.0]])
    assert LIMITER.room_ahead(obstacles) == pytest.approx(distance - RADIUS - CLEARANCE_AHEAD, abs=0.02)
    assert LIMITER.room_ahead(obstacles[1:]) == math.inf
