# SPDX-License-Identifier: MIT
"""Many robots in one call do what each of them would do alone, bit for bit."""

import dataclasses

import numpy as np
import pytest

from testbed.presets import load_lidar
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, OdometryConfig
from testbed.simulation.fleet.fleet import Fleet
from testbed.simulation.fleet.robot_group import RobotSetup, Terrain
from testbed.simulation.fleet.single_robot import BackendRobot
from testbed.simulation.physics.fast import FastBackend
from tests.testbed.simulation.small_worlds import PERFECT_ODOMETRY, random_world, room

SETUP = RobotSetup(
    lidar=load_lidar("rplidar_a2").model_copy(update={"beams": 90}),
    odometry=OdometryConfig(slip_rate=0.5, lost_ticks=0.01),
)
HEIGHT = SETUP.robot.lidar_mount.height
TERRAINS = [Terrain(random_world(np.random.default_rng(seed)), HEIGHT) for seed in range(3)]
START = np.array([0.0, 0.0, 0.5])
ROBOTS, PERIODS = 5, 40


def commands(seed):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.2, 0.45, PERIODS), rng.uniform(-1.5, 1.5, PERIODS)])


def same(a, b):
    return all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))


def alone(robot):
    """Readings of one robot in a fleet of one, one row a period."""
    fleet = Fleet(1, SETUP)
    fleet.place(0, TERRAINS[robot % 3], START, RunSeeds.from_seed(robot))
    return [tuple(part[0] for part in fleet.step(command[None])) for command in commands(robot)]


def test_a_robot_of_a_fleet_does_what_it_would_do_alone():
    fleet = Fleet(ROBOTS, SETUP)
    for robot in reversed(range(ROBOTS)):
        fleet.place(robot, TERRAINS[robot % 3], START, RunSeeds.from_seed(robot))
    together = [fleet.step(targets) for targets in np.stack([commands(robot) for robot in range(ROBOTS)], axis=1)]
    for robot in range(ROBOTS):
        assert all(
            same(lone, [part[robot] for part in readings])
            for lone, readings in zip(alone(robot), together, strict=True)
        )
    assert not same(alone(0)[-1], alone(3)[-1])  # the same place, another seed


def test_robots_may_take_turns_and_move_to_other_places():
    """Some robots go on while others stand; one is placed anew in between: the others do not notice."""
    fleet = Fleet(2, SETUP)
    fleet.place(1, TERRAINS[1], START, RunSeeds.from_seed(1))
    found, targets = [], np.zeros((2, 2))
    for period, command in enumerate(commands(1)):
        targets[1] = command
        found.append([part[1] for part in fleet.step(targets, np.array([1]))])
        if period % 3 == 0:
            fleet.place(0, TERRAINS[period % 2], START, RunSeeds.from_seed(period))
            fleet.step(targets, np.array([0]))
    assert all(same(a, b) for a, b in zip(alone(1), found, strict=True))


def test_a_backend_robot_equals_a_fleet_of_one():
    robot = BackendRobot(SETUP, FastBackend)
    robot.place(0, TERRAINS[1], START, RunSeeds.from_seed(1))
    found = [[part[0] for part in robot.step(command[None])] for command in commands(1)]
    assert all(same(a, b) for a, b in zip(alone(1), found, strict=True))


def test_physics_and_kinematics_see_the_same_room():
    pytest.importorskip("pybullet")
    from testbed.simulation.physics.pybullet import PyBulletBackend

    setup = dataclasses.replace(SETUP, lidar_layers=LidarLayers.none(), odometry=PERFECT_ODOMETRY)
    terrain = Terrain(room(), HEIGHT)
    ends = []
    for group in (Fleet(1, setup), BackendRobot(setup, PyBulletBackend)):
        group.place(0, terrain, START, RunSeeds.from_seed(0))
        for _ in range(30):
            readings = group.step(np.array([[0.3, 0.2]]))
        group.close()
        ends.append(readings)
    np.testing.assert_allclose(ends[1].truth, ends[0].truth, atol=0.01)
    np.testing.assert_allclose(ends[1].odometry, ends[0].odometry, atol=0.01)
    assert np.quantile(np.abs(ends[1].ranges - ends[0].ranges), 0.95) < 0.03


def test_contact_is_told_and_the_scan_shows_the_wall():
    setup = dataclasses.replace(SETUP, lidar_layers=LidarLayers.none())
    fleet = Fleet(2, setup)
    for robot in range(2):
        fleet.place(robot, Terrain(room(), HEIGHT), np.zeros(3), RunSeeds.from_seed(robot))
    for _ in range(150):
        readings = fleet.step(np.array([[0.45, 0.0], [0.0, 0.0]]))
    assert readings.contact.tolist() == [True, False]
    assert 5.0 - readings.truth[0, 0] == pytest.approx(setup.robot.footprint_radius, abs=0.01)
    ahead = setup.steady_lidar.angles().size // 2
    assert readings.ranges[0, ahead] == pytest.approx(
        setup.robot.footprint_radius - setup.robot.lidar_mount.x, abs=0.01
    )
