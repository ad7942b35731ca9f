# SPDX-License-Identifier: MIT
"""The tour driver on an ideal robot: stays near the path, keeps to limits, finishes, notices when it is stuck."""

import math

import numpy as np
import pytest
import shapely

from testbed.presets import load_robot
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.drivers.tour import TourDriver

ROBOT = load_robot("create3")


def follow(path, config=None, seconds=300.0, held_at=None):
    """Poses (n, 3) of a robot that does at once what the driver says; it cannot pass x = held_at."""
    driver = TourDriver(np.array(path), ROBOT, config or DriverConfig())
    x, y, theta = *path[0], 0.0
    poses, commands, dt = [], [], 0.05
    for k in range(int(seconds / dt)):
        v, w = driver.command(k * dt, x, y, theta)
        if driver.finished or driver.stuck:
            break
        theta += w * dt
        if held_at is None or x + v * math.cos(theta) * dt < held_at:
            x, y = x + v * math.cos(theta) * dt, y + v * math.sin(theta) * dt
        poses.append((x, y, theta))
        commands.append((v, w))
    return driver, np.array(poses), np.array(commands)


@pytest.mark.parametrize(
    "path",
    [
        [(0, 0), (5, 0)],
        [(0, 0), (-5, 0.1)],
        [(0, 0), (4, 0), (4, 3), (0, 3), (0, 0)],
        [(0, 0), (3, 0), (3, 2), (3, 0), (6, 0)],
        [(0, 0), (2, 0), (0, 0.5), (2, 1.0), (0, 1.5)],
        [(0, 0)] + [(2 * math.sin(a / 5), 2 - 2 * math.cos(a / 5)) for a in range(1, 30)],
    ],
    ids=["straight", "behind", "square", "dead end", "zigzag", "circle"],
)  # fmt: skip
def test_the_path_is_followed_to_its_end_within_limits(path):
    driver, poses, commands = follow(path)
    assert driver.finished
    assert driver.recoveries == 0
    line = shapely.LineString(path)
    assert shapely.distance(shapely.points(poses[:, :2]), line).max() < 0.16
    # every part of the path was visited, but for the tips of dead ends
    visited = shapely.LineString(poses[:, :2])
    assert max(visited.distance(line.interpolate(s)) for s in np.arange(0.0, line.length, 0.1)) < 0.45
    assert math.dist(poses[-1, :2], path[-1]) < 0.1
    assert commands[:, 0].max() <= min(ROBOT.max_speed, DriverConfig().speed)
    assert np.abs(commands[:, 1]).max() <= DriverConfig().turn_rate + 1e-12


def test_a_robot_that_cannot_move_on_backs_off_and_is_given_up():
    driver, poses, commands = follow([(0, 0), (5, 0)], held_at=2.0)
    assert driver.stuck
    assert not driver.finished
    assert commands[:, 0].min() < 0.0
    assert poses[:, 0].max() < 2.0


def test_a_tour_needs_two_corners():
    with pytest.raises(ValueError, match="at least two different corners"):
        TourDriver(np.array([(1.0, 1.0), (1.0, 1.0)]), ROBOT, DriverConfig())


@pytest.mark.parametrize("field", ["speed", "turn_rate", "lookahead", "patience"])
def test_bad_settings_are_refused(field):
    with pytest.raises(ValueError, match=f"{field} must be positive"):
        DriverConfig(**{field: 0.0})
