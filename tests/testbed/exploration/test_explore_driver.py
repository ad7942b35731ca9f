# SPDX-License-Identifier: MIT
"""Explorers on ideal robots and in whole simulations: they find what there is, keep clear of walls, and end."""

import numpy as np
import pytest

from slam.config import FilterConfig
from slam.gmapping import GMapping
from testbed.exploration import STRATEGIES, ExploreDriver, make_explorer
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import DriverConfig, SimulationConfig, simulate
from tests.testbed.exploration.hand_drawn_maps import belief, grid_of
from worlds import Box, Start, Wall, World, generate, load, true_map

ROBOT, LIDAR = load_robot("create3"), load_lidar("rplidar_a2").model_copy(update={"beams": 180})
CONFIG = DriverConfig()


def explorer(strategy, seed=0):
    return make_explorer(ROBOT, LIDAR, DriverConfig(strategy=strategy), np.random.default_rng(seed))


def explore(world, strategy="nearest", duration=150.0, seed=0, backend="fast", **settings):
    """The simulation, the filter and the explorer at the end of a drive with the estimate in the loop."""
    config = SimulationConfig(
        lidar=LIDAR, duration=duration, seeds=RunSeeds.from_seed(seed), backend=backend,
        driver=DriverConfig(kind="explore", strategy=strategy), **settings,
    )  # fmt: skip
    driver, mapper = ExploreDriver(explorer(strategy, seed)), GMapping(FilterConfig(particles=5), threads=1)
    with simulate(world, config, driver) as simulation:
        for frame in simulation:
            if frame.scan is not None:
                driver.observe(frame, mapper.process(frame.odometry, frame.scan, twist=frame.twist), mapper.map)
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
def test_frontier_explorers_map_everything_and_finish(strategy):
    simulation, mapper = explore(two_rooms(), strategy)
    assert simulation.finished
    assert not simulation.collided
    assert simulation.driver.recoveries == 0
    assert simulation.time < 100.0
    assert 0.95 < share_mapped(two_rooms(), mapper) < 1.05


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rooms", "loops", "maze", "cave", "warehouse"])
def test_frontier_explorers_map_generated_worlds(kind):
    world = generate(kind, size=(12.0, 10.0), clutter=0.5, seed=3)
    simulation, mapper = explore(world, "nearest", duration=400.0)
    assert simulation.finished
    assert not simulation.collided
    assert share_mapped(world, mapper) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["fast", "pybullet"])
@pytest.mark.parametrize("seed", [3, 4])
def test_explorers_touch_nothing_in_a_furnished_apartment(backend, seed):
    """Turns beside furniture: a robot that looks straight ahead only touches some of it."""
    if backend == "pybullet":
        pytest.importorskip("pybullet")
    simulation, mapper = explore(load("apartment"), "information", duration=500.0, seed=seed, backend=backend)
    assert not simulation.collided
    assert simulation.finished
    assert share_mapped(load("apartment"), mapper) > 0.95


@pytest.mark.parametrize("strategy", ["wall", "random"])
def test_reactive_explorers_keep_moving_and_touch_nothing(strategy):
    simulation, mapper = explore(two_rooms(), strategy, duration=60.0)
    assert not simulation.finished
    assert not simulation.collided
    path = mapper.path()
    assert np.hypot(*np.diff(path[:, :2], axis=0).T).sum() > 8.0


def test_the_wall_follower_keeps_the_wall_on_its_right():
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
                    driver.observe(frame, mapper.process(frame.odometry, frame.scan, twist=frame.twist), mapper.map)
        drives.append(np.array(frames))
    assert np.array_equal(*drives)
    assert np.hypot(*(drives[0][-1] - drives[0][0])[:2]) > 0.5


def test_strategies_are_checked():
    assert set(STRATEGIES) == {"information", "nearest", "wall", "random"}
    with pytest.raises(ValueError, match="strategy must be one of information, nearest, wall, random, got 'psychic'"):
        DriverConfig(strategy="psychic")


OPEN_ROOM = "#######\n#.....?\n#.....?\n#.....?\n#######"


def test_a_robot_that_does_not_move_backs_off_and_gives_up():
    """The map shows a way on; the robot stands still whatever is commanded."""
    lost, grid = explorer("nearest"), grid_of(OPEN_ROOM, 16)
    commands = [lost.command(belief(grid, (2.0, 2.0, 0.0), stamp=0.05 * k)) for k in range(3000)]
    speeds = [speed for speed, _ in commands]
    assert min(speeds) < 0.0 < max(speeds)
    assert lost.recoveries == CONFIG.max_recoveries + 1
    assert lost.stuck
    assert not lost.finished
    assert commands[-1] == (0.0, 0.0)


def test_time_spent_waiting_is_no_lack_of_progress():
    patient, grid = explorer("nearest"), grid_of(OPEN_ROOM, 16)
    for k in range(400):
        patient.command(belief(grid, (2.0, 2.0, 0.0), stamp=0.05 * k))
        patient.wait(0.05 * k)
    assert patient.recoveries == 0
