# SPDX-License-Identifier: MIT
"""Explorers on ideal robots and in whole simulations: they find what there is, keep clear of walls, and end."""

import dataclasses
import math

import numpy as np
import pytest

from slam.config import FilterConfig
from slam.gmapping import GMapping
from testbed.exploration import STRATEGIES, ExploreDriver, make_explorer
from testbed.exploration.collision_limiter import CLEARANCE_AHEAD, LATENCY, CollisionLimiter
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import DriverConfig, SimulationConfig, simulate
from testbed.simulation.drivers.stuck_recovery import StuckRecovery
from tests.testbed.exploration.places import belief, grid_of, scan_of
from worlds import Box, Start, Wall, World, generate, true_map

ROBOT, LIDAR = load_robot("create3"), load_lidar("rplidar_a2").model_copy(update={"beams": 180})
CONFIG = DriverConfig()


def explorer(strategy, seed=0):
    return make_explorer(ROBOT, LIDAR, DriverConfig(strategy=strategy), np.random.default_rng(seed))


def explore(world, strategy="nearest", duration=150.0, seed=0, **settings):
    """The simulation, the filter and the explorer at the end of a drive with the estimate in the loop."""
    config = SimulationConfig(
        lidar=LIDAR, backend="fast", duration=duration, seeds=RunSeeds.from_seed(seed),
        driver=DriverConfig(kind="explore", strategy=strategy), **settings,
    )  # fmt: skip
    driver, mapper = ExploreDriver(explorer(strategy, seed)), GMapping(FilterConfig(particles=5), threads=1)
    with simulate(world, config, driver) as simulation:
        for frame in simulation:
            if frame.scan is not None:
                driver.observe(frame, mapper.process(frame.odometry, frame.scan, twist=frame.twist), mapper)
    return simulation, mapper


def share_mapped(world, mapper):
    """Known free floor of the estimate as a share of the true floor."""
    grid, truth = mapper.map(), true_map(world)
    return grid.free.sum() * grid.resolution**2 / (truth.free.sum() * truth.resolution**2)


def two_rooms():
    return World(
        name="two rooms",
        start=Start(x=1.0, y=1.0),
        walls=[Wall(name="outline", points=[(0, 0), (8, 0), (8, 4), (0, 4)], closed=True)],
        boxes=[
            Box(name="below", x=4.0, y=0.75, width=0.2, depth=1.5),
            Box(name="above", x=4.0, y=3.25, width=0.2, depth=1.5),
            Box(name="desk", x=6.5, y=3.6, width=1.2, depth=0.8),
        ],
    )


@pytest.mark.parametrize("strategy", ["nearest", "information"])
def test_frontier_explorers_map_everything_and_say_when_they_have(strategy):
    simulation, mapper = explore(two_rooms(), strategy)
    assert simulation.finished
    assert not simulation.collided
    assert simulation.driver.recoveries == 0
    assert simulation.time < 100.0
    assert 0.95 < share_mapped(two_rooms(), mapper) < 1.05


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rooms", "loops", "maze", "cave", "warehouse"])
def test_frontier_explorers_map_generated_worlds_without_a_collision(kind):
    world = generate(kind, size=(12.0, 10.0), clutter=0.5, seed=3)
    simulation, mapper = explore(world, "nearest", duration=400.0)
    assert simulation.finished
    assert not simulation.collided
    assert share_mapped(world, mapper) > 0.9


@pytest.mark.parametrize("strategy", ["wall", "random"])
def test_reactive_explorers_keep_moving_and_touch_nothing(strategy):
    simulation, mapper = explore(two_rooms(), strategy, duration=60.0)
    assert not simulation.finished
    assert not simulation.collided
    path = mapper.path()
    assert np.hypot(*np.diff(path[:, :2], axis=0).T).sum() > 8.0


def test_the_wall_follower_goes_round_the_room_with_the_wall_at_its_right():
    room = World(
        name="room",
        start=Start(x=1.0, y=1.0),
        walls=[Wall(name="outline", points=[(0, 0), (5, 0), (5, 4), (0, 4)], closed=True)],
    )
    _, mapper = explore(room, "wall", duration=90.0)
    x, y = (mapper.path()[:, :2] + 1.0).T
    from_wall = np.minimum.reduce([x, y, 5.0 - x, 4.0 - y])
    assert np.median(from_wall[len(x) // 4 :]) == pytest.approx(ROBOT.footprint_radius + 0.25, abs=0.12)
    assert np.ptp(x) > 3.5
    assert np.ptp(y) > 2.5


class LiedTo(ExploreDriver):
    """Is told that the robot is somewhere else."""

    def command(self, stamp, x, y, theta):
        return super().command(stamp, x + 50.0, -y, theta + 1.0)


def test_the_driver_does_not_look_at_the_truth():
    drives = []
    for kind in (ExploreDriver, LiedTo):
        driver, mapper = kind(explorer("nearest")), GMapping(FilterConfig(particles=3), threads=1)
        assert driver.command(0.0, 1.0, 2.0, 3.0) == (0.0, 0.0)  # nothing was seen yet
        with simulate(two_rooms(), SimulationConfig(lidar=LIDAR, backend="fast", duration=6.0), driver) as simulation:
            frames = []
            for frame in simulation:
                frames.append(frame.truth)
                if frame.scan is not None:
                    driver.observe(frame, mapper.process(frame.odometry, frame.scan, twist=frame.twist), mapper)
        drives.append(np.array(frames))
    assert np.array_equal(*drives)
    assert np.hypot(*(drives[0][-1] - drives[0][0])[:2]) > 0.5


def test_strategies_are_checked():
    assert set(STRATEGIES) == {"information", "nearest", "wall", "random"}
    with pytest.raises(ValueError, match="strategy must be one of information, nearest, wall, random, got 'psychic'"):
        DriverConfig(strategy="psychic")


# --- a robot that does not get on -------------------------------------------------------------------------------------

OPEN_ROOM = "#######\n#.....?\n#.....?\n#.....?\n#######"


def test_a_robot_that_does_not_move_backs_off_shuns_its_goal_and_is_given_up_at_last():
    """The map shows a way on; the robot stands still whatever is commanded."""
    lost, grid = explorer("nearest"), grid_of(OPEN_ROOM, 16)
    commands = [lost.command(belief(grid, (2.0, 2.0, 0.0), stamp=0.05 * k)) for k in range(3000)]
    speeds = [speed for speed, _ in commands]
    assert min(speeds) < 0.0 < max(speeds)
    assert lost.recoveries >= 1
    assert lost.stuck or lost.finished or commands[-1][1] != 0.0  # turns, looking for another goal
    assert not (lost.stuck and lost.finished)


def test_time_spent_waiting_is_no_lack_of_progress():
    patient, grid = explorer("nearest"), grid_of(OPEN_ROOM, 16)
    for k in range(400):
        patient.command(belief(grid, (2.0, 2.0, 0.0), stamp=0.05 * k))
        patient.wait(0.05 * k)
    assert patient.recoveries == 0


def test_backing_off_takes_patience_and_lasts_two_seconds():
    back_off = StuckRecovery(patience=5.0)
    steps = [back_off.command(0.05 * k, 1.0, 1.0, 0.1 * math.sin(k)) for k in range(240)]
    assert [step is not None for step in steps].index(True) == 101
    assert sum(step is not None for step in steps) == 40
    assert back_off.count == 1
    moving = StuckRecovery(patience=5.0)
    assert all(moving.command(0.05 * k, 0.02 * k, 0.0, 0.0) is None for k in range(400))
    turning = StuckRecovery(patience=5.0)
    assert all(turning.command(0.05 * k, 0.0, 0.0, 0.02 * k) is None for k in range(400))


@pytest.mark.parametrize("distance", [0.4, 0.6, 1.0, 2.0])
def test_the_guard_lets_the_robot_stop_before_what_it_sees(distance):
    limiter = CollisionLimiter(ROBOT, CONFIG)
    obstacle = np.array([[distance, 0.05], [-0.3, 0.0], [0.5, 1.0]])
    room = distance - ROBOT.footprint_radius - CLEARANCE_AHEAD
    assert limiter.room_ahead(obstacle) == pytest.approx(room, abs=0.02)
    speed = limiter.limited(5.0, obstacle)
    braking = min(CONFIG.acceleration, ROBOT.max_acceleration)
    assert speed * LATENCY + speed**2 / (2.0 * braking) == pytest.approx(max(room, 0.0), abs=0.02)
    assert limiter.limited(-0.1, obstacle) == -0.1
    assert limiter.limited(0.3, np.array([[1.0, 1.0], [-0.2, 0.0]])) == 0.3


def test_obstacles_are_seen_from_the_robot_and_not_from_its_lidar():
    scan = dataclasses.replace(scan_of([np.inf, np.inf, 2.0, np.inf]), mount=(0.5, 0.0, math.pi / 2.0))
    both = belief(None, (0, 0, 0), scans=(scan, scan_of([np.inf, np.inf, 1.0, np.inf])))
    np.testing.assert_allclose(both.obstacles(), [[0.5, 2.0], [1.0, 0.0]], atol=1e-12)
