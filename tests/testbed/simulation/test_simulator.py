# SPDX-License-Identifier: MIT
"""Whole simulations: truth against commands and geometry, determinism, independence of the noise streams."""

import dataclasses
import math
import sys
import types
from importlib.machinery import ModuleSpec

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.se2 import between, compose, transform_points
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, SimulationConfig, SurfaceConfig, simulate, simulator
from testbed.simulation.drivers.tour import TourDriver
from testbed.simulation.physics.backend import STEP_RATE, AccelerationLimits
from testbed.simulation.physics.fast import FastBackend
from tests.testbed.equal_frames import assert_equal_frames
from tests.testbed.simulation.small_worlds import perfect, room
from worlds import Box, Door, Person, WorldError, catalogue, load

LIMITS = AccelerationLimits(0.5, 3.0)


def make_backend(kind, world, robot):
    if kind == "fast":
        return FastBackend(world, robot, LIMITS)
    pytest.importorskip("pybullet")
    module = pytest.importorskip("testbed.simulation.physics.pybullet")
    return module.PyBulletBackend(world, robot, LIMITS)


@pytest.fixture(params=["pybullet", "fast"])
def kind(request):
    if request.param == "pybullet":
        pytest.importorskip("pybullet")
    return request.param


def frames(world, config):
    with simulate(world, config) as simulation:
        return list(simulation)


def test_drives_straight(kind):
    backend = make_backend(kind, room(half=20.0), load_robot("create3"))
    poses = backend.drive(0.4, 0.0, 30 * STEP_RATE).poses
    backend.close()
    ramp = 0.5 * 0.4**2 / 0.5  # metres lost while speeding up
    assert poses[-1, 0] == pytest.approx(12.0 - ramp, abs=0.03)
    assert abs(poses[-1, 1]) < 0.02
    assert abs(poses[-1, 2]) < 0.003


@pytest.mark.parametrize("speed", [0.0, 0.2])
@pytest.mark.parametrize("turn_rate", [0.5, -0.5])
def test_turns_true(kind, speed, turn_rate):
    backend = make_backend(kind, room(half=20.0), load_robot("create3"))
    backend.drive(speed, turn_rate, STEP_RATE)
    motion = backend.drive(speed, turn_rate, 10 * STEP_RATE)
    backend.close()
    begin, end = motion.poses[0], motion.poses[-1]
    seconds = (len(motion.poses) - 1) / STEP_RATE
    assert (end[2] - begin[2]) / seconds == pytest.approx(turn_rate, rel=0.003)
    path = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T).sum()
    assert path / seconds == pytest.approx(speed, abs=0.003)


def test_truth_is_the_pose_of_base_link(kind):
    """On the spot, base_link stays while a point behind it would go round in a circle."""
    backend = make_backend(kind, room(start=(1.0, 2.0, 0.7)), load_robot("create3"))
    poses = backend.drive(0.0, 1.0, 7 * STEP_RATE).poses
    backend.close()
    assert np.hypot(*(poses[:, :2] - (1.0, 2.0)).T).max() < 0.003
    assert poses[0, 2] == pytest.approx(0.7, abs=1e-3)


def test_wheel_odometry_without_errors_is_the_truth(kind):
    result = frames(room(tour=[(3, 0), (3, 3), (-2, 3)]), perfect(backend=kind))
    truth, odometry = (np.array([getattr(frame, name) for frame in result]) for name in ("truth", "odometry"))
    error = between(between(truth[0], truth), between(odometry[0], odometry))
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.02
    assert np.abs(error[:, 2]).max() < 0.01


def test_beams_placed_at_their_own_times_end_on_walls(kind):
    """Truth, mount, beam angles and times together put every end point of a moving robot on the room's outline."""
    robot = load_robot("create3")
    mount = robot.lidar_mount.model_copy(update={"x": -0.04, "y": 0.05, "theta_deg": 30.0})
    config = perfect(backend=kind, robot=robot.model_copy(update={"lidar_mount": mount}))
    config = dataclasses.replace(config, lidar_layers=dataclasses.replace(LidarLayers.none(), motion=True))
    result = frames(room(tour=[(3, 0), (0, 2)]), config)
    stamps = np.array([frame.stamp for frame in result])
    truth = np.array([frame.truth for frame in result])
    truth[:, 2] = np.unwrap(truth[:, 2])
    checked = 0
    for frame in result[40:-4]:
        if frame.scan is None:
            continue
        scan = frame.scan
        times = scan.stamp + scan.time_offsets
        robots = np.stack([np.interp(times, stamps, truth[:, k]) for k in range(3)], axis=-1)
        points = scan.ranges[:, None] * np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=-1)
        ends = transform_points(compose(robots, scan.mount), points[:, None, :])[:, 0]
        off = np.abs(np.abs(ends).max(axis=1) - 5.0)
        assert off.max() < 0.008  # truth at 20 Hz: 3 rad/s² between two frames bend the heading by 1 mrad, at 7 m
        checked += 1
    assert checked > 30


def test_the_motion_layer_distorts_scans_of_a_moving_robot():
    world, config = room(tour=[(3, 0), (0, 2)]), perfect(backend="fast")
    moving = dataclasses.replace(config, lidar_layers=dataclasses.replace(LidarLayers.none(), motion=True))
    still, distorted = ([f.scan for f in frames(world, c) if f.scan] for c in (config, moving))
    assert still[0].time_offsets is None
    assert distorted[0].time_offsets[-1] == pytest.approx(0.1, rel=0.01)
    difference = [np.abs(a.ranges - b.ranges).max() for a, b in zip(still, distorted, strict=False)]
    assert max(difference) > 0.03


def test_stamps_increase_and_scans_come_at_their_rate(kind):
    config = perfect(backend=kind, duration=5.0)
    config = dataclasses.replace(config, lidar=config.lidar.model_copy(update={"scan_rate": 5.5, "beams": 90}))
    result = frames(room(), config)
    assert np.all(np.diff([frame.stamp for frame in result]) > 0)
    stamps = [frame.scan.stamp for frame in result if frame.scan]
    np.testing.assert_allclose(np.diff(stamps), 1 / 5.5)
    assert all(frame.scan.stamp == frame.stamp for frame in result if frame.scan)
    assert all(np.all(np.isfinite([*frame.odometry, *frame.twist, *frame.truth])) for frame in result)


def test_scans_come_at_the_times_of_the_lidar_that_states_them():
    """Blocks of frames are equal to single ones; odometry goes on after the last scan."""
    times = (0.0, 0.21, 0.22, 1.503)
    lidar = load_lidar("lds01").model_copy(update={"scan_times": times})
    config = SimulationConfig(lidar=lidar, lidar_layers=LidarLayers(motion=False), backend="fast", duration=3.0)
    single = frames(load("office"), config)
    assert tuple(frame.stamp for frame in single if frame.scan is not None) == times
    assert single[-1].stamp > 2.9
    with simulate(load("office"), config) as simulation:
        assert_equal_frames([frame for block in simulation.blocks(7) for frame in block.frames()], single)


def test_twist_is_the_velocity_of_the_odometry(kind):
    result = frames(room(tour=[(4, 0)]), perfect(backend=kind, duration=6.0))
    twist = np.array([frame.twist for frame in result if 2.0 < frame.stamp < 5.0])
    np.testing.assert_allclose(twist, [[0.45, 0.0, 0.0]] * len(twist), atol=0.01)


def same(a, b):
    return len(a) == len(b) and all(
        x.stamp == y.stamp
        and np.array_equal(x.odometry, y.odometry)
        and np.array_equal(x.truth, y.truth)
        and (x.scan is None) == (y.scan is None)
        and (x.scan is None or np.array_equal(x.scan.ranges, y.scan.ranges, equal_nan=True))
        for x, y in zip(a, b, strict=True)
    )


def test_a_seed_determines_the_bits(kind):
    config = SimulationConfig(backend=kind, duration=4.0)
    first, again = frames(room(), config), frames(room(), config)
    assert same(first, again)
    assert not same(first, frames(room(), dataclasses.replace(config, seeds=RunSeeds.from_seed(1))))


def crowded(**settings):
    """A world and settings that use everything a block can hold: two lidars, a number of beams that varies, movers."""
    world = room(
        tour=[(3, 0), (3, 2)],
        half=8.0,
        people=[Person(points=[(-2.0, 4.0), (2.0, 4.0)])],
        doors=[Door(x=7.9, y=2.0, closed=1.5, swing=1.5)],
    )
    uneven = {"beams": 40, "scan_rate": 5.5, "beam_jitter": 0.1, "field_of_view_deg": 270.0}
    config = SimulationConfig(
        backend="fast",
        robot=load_robot("pioneer3dx"),
        lidar=load_lidar("rplidar_a2").model_copy(update=uneven),
        further_lidars=(load_lidar("lds01").model_copy(update={"beams": 30, "scan_rate": 40.0}),),
        duration=6.0,
        surface=SurfaceConfig(roughness=0.02, scatter=0.05, scatter_share=0.1),
    )
    return world, dataclasses.replace(config, **settings)


@given(size=st.integers(1, 400), seed=st.integers(0, 5))
@settings(max_examples=15, deadline=None)
def test_blocks_of_any_size_equal_stepping(size, seed):
    world, config = crowded(seeds=RunSeeds.from_seed(seed))
    stepped = [frame for block in simulate(world, config).blocks(1) for frame in block.frames()]
    tables = list(simulate(world, config).blocks(size))
    assert [len(table) for table in tables[:-1]] == [size] * (len(tables) - 1)
    assert [table.first for table in tables] == [size * k for k in range(len(tables))]
    assert_equal_frames([frame for table in tables for frame in table.frames()], stepped)
    assert {frame.lidar for frame in stepped if frame.scan} == {"laser", "rear_laser"}


@pytest.mark.parametrize("seed", range(3))
def test_periods_driven_by_one_call_equal_periods_driven_one_by_one(monkeypatch, seed):
    """Wheels slip so far that they turn the odometry by more than half a turn within one period."""
    config = SimulationConfig(backend="fast", lidar=load_lidar("lds01"), robot=load_robot("pioneer3dx"), duration=40.0)
    slipping = dataclasses.replace(config.odometry, slip_rate=1.0, slip_distance=2.0)
    config = dataclasses.replace(config, odometry=slipping, seeds=RunSeeds.from_seed(seed))
    together = frames(load("maze"), config)
    monkeypatch.setattr(simulator, "PERIODS_AHEAD", 1)
    one_by_one = frames(load("maze"), config)
    assert_equal_frames(together, one_by_one)
    turns = np.abs(np.diff([frame.odometry[2] for frame in one_by_one]))
    assert (turns > 1.0).any()


class Listener:
    """A driver that listens to the frames, as an exploring one does; it drives along a tour."""

    def __init__(self, world, config):
        self.tour = TourDriver(world.path(), config.robot, config.driver)
        self.last, self.delays = 0.0, []

    def command(self, stamp, x, y, theta):
        self.delays.append(stamp - self.last)
        return self.tour.command(stamp, x, y, theta)

    def __getattr__(self, name):
        return getattr(self.tour, name)


def test_a_driver_has_seen_all_complete_frames_when_it_commands():
    world, config = room(), perfect(backend="fast", duration=2.0)
    driver = Listener(world, config)
    for frame in simulate(world, config, driver):
        driver.last = frame.stamp
    assert max(driver.delays) < 0.11  # the period of the scans


@pytest.mark.parametrize("box", [None, Box(x=2.0, y=0.0, width=0.2, depth=2.0)])
def test_many_periods_at_once_equal_single_ones(box):
    """The drive goes to its end; with a box on the way the robot pushes it, backs off and is given up."""
    world, config = room(tour=[(4, 0)]), SimulationConfig(backend="fast", duration=100.0)
    drives = []
    for driver in (None, Listener(world, config)):
        simulation = simulate(world, config, driver)
        if box is not None:
            simulation.world = world.model_copy(update={"boxes": [box]})
        made = list(simulation)
        drives.append(made)
        assert (simulation.stuck, simulation.collided, simulation.finished) == (box is not None,) * 2 + (box is None,)
    assert_equal_frames(*drives)


def test_changing_the_lidar_leaves_the_odometry_alone():
    config = SimulationConfig(backend="fast", duration=8.0)
    silent = dataclasses.replace(config, lidar_layers=LidarLayers.none())
    fewer = dataclasses.replace(config, lidar=config.lidar.model_copy(update={"beams": 90}))
    expected = [frame.odometry for frame in frames(room(), config)]
    for other in (silent, fewer):
        odometry = [frame.odometry for frame in frames(room(), other)]
        common = min(len(expected), len(odometry)) - 4  # the last scan that fits into the time differs
        assert common > 135
        assert np.array_equal(expected[:common], odometry[:common])


def test_a_robot_that_hits_a_wall_says_so_and_is_given_up(kind):
    """A box on the tour that is lower than the check sees: the driver pushes, backs off, gives up."""
    world = room(tour=[(4, 0)])
    config = perfect(backend=kind)
    simulation = simulate(world, config)
    simulation.world = world.model_copy(update={"boxes": [Box(x=2.0, y=0.0, width=0.2, depth=2.0)]})
    for _ in simulation:
        pass
    assert simulation.collided
    assert simulation.stuck
    assert not simulation.finished
    assert simulation.driver.recoveries > 3


def test_a_tour_is_finished_and_the_robot_stands_at_its_end(kind):
    with simulate(room(tour=[(2, 0), (2, 1)]), perfect(backend=kind)) as simulation:
        last = [frame.truth for frame in simulation][-1]
    assert simulation.finished
    assert not simulation.collided
    assert math.dist(last[:2], (2, 1)) < 0.15


def test_closing_early_frees_the_physics_client():
    pytest.importorskip("pybullet")
    module = pytest.importorskip("testbed.simulation.physics.pybullet")
    closed = []
    original = module.PyBulletBackend.close
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module.PyBulletBackend, "close", lambda self: (closed.append(self), original(self)))
        simulation = simulate(room(), perfect())
        next(simulation)
        simulation.close()
        simulation.close()
    assert len(closed) == 1
    assert list(simulation) == []


def test_worlds_without_a_fitting_tour_are_refused():
    with pytest.raises(WorldError, match="has no tour"):
        simulate(room().model_copy(update={"tour": None}), perfect())
    with pytest.raises(WorldError, match=r"robot 'create3' does not fit: .*the footprint"):
        simulate(room(tour=[(4.9, 0)]), perfect())
    with pytest.raises(ValueError, match="duration must be above 0"):
        SimulationConfig(duration=0.0)


def test_missing_pybullet_is_explained_in_one_line(monkeypatch):
    from testbed.simulation.physics.pybullet import PyBulletMissingError

    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(PyBulletMissingError, match="pip install pybullet") as caught:
        next(simulate(room(), perfect(backend="pybullet")))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("module", "backend"), [(types.ModuleType("pybullet"), "pybullet"), (None, "fast")])
def test_auto_is_pybullet_where_it_is_installed(monkeypatch, module, backend):
    if module is not None:
        module.__spec__ = ModuleSpec("pybullet", None)
    monkeypatch.setitem(sys.modules, "pybullet", module)
    assert SimulationConfig().backend == SimulationConfig(backend="auto").backend == backend
    assert SimulationConfig(backend="fast").backend == "fast"
    assert SimulationConfig(backend="pybullet").backend == "pybullet"


def test_presets_of_several_rates_fit_together():
    config = SimulationConfig(backend="fast", lidar=load_lidar("rplidar_a2"), robot=load_robot("create3"), duration=3.0)
    scans = [frame.scan for frame in frames(room(), config) if frame.scan]
    assert {scan.mount for scan in scans} == {config.robot.lidar_mount.pose}
    assert all(len(scan.ranges) == 800 for scan in scans)


@pytest.mark.parametrize("name", catalogue())
def test_every_tour_of_the_catalogue_is_driven_to_its_end(name):
    lidar = load_lidar("rplidar_a2").model_copy(update={"beams": 8, "scan_rate": 2.0})
    with simulate(load(name), SimulationConfig(backend="fast", lidar=lidar)) as simulation:
        for _ in simulation:
            pass
    assert simulation.finished
    assert not simulation.collided
    assert simulation.driver.recoveries == 0
