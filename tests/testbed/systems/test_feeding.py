# SPDX-License-Identifier: MIT
"""What a system sees, what becomes of what it returns, and how mistakes are named."""

import os
import sys

import numpy as np
import pytest

from eval.trajectory.trajectory import Trajectory
from slam import GMapping, se2
from slam.config import FilterConfig
from slam.occupancy import OccupancyGrid
from testbed.systems.errors import SystemFailedError
from testbed.systems.feeding import FORKED, estimated_from, feed, rows_of
from tests.testbed.systems.room import Wheels, frames

GRID = OccupancyGrid(probability=np.full((200, 200), 0.1, np.float32), resolution=0.05, origin=(-5.0, -5.0, 0.0))


def test_a_system_sees_all_frames_but_no_truth():
    system, drive = Wheels(), frames()
    feed(system, "w", drive, seed=7)
    assert [frame.stamp for frame in system.seen] == [frame.stamp for frame in drive]
    assert all(frame.truth is None for frame in system.seen)
    assert all(frame.truth is not None for frame in drive)
    assert system.seed == 7
    (lidar,) = system.lidars
    assert (lidar.name, lidar.range_max, lidar.mount) == ("laser", 20.0, (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(lidar.angles, drive[0].scan.angles)


class Vandal(Wheels):
    def process(self, frame):
        frame.odometry[:] = 9.0
        if frame.scan is not None:
            frame.scan.ranges[:] = 9.0
            frame.scan.angles[:] = 9.0
        return frame.odometry


def test_what_a_system_does_to_its_frames_stays_its_own():
    drive, untouched = frames(), frames()
    feed(Vandal(), "v", drive, seed=0)
    for frame, before in zip(drive, untouched, strict=True):
        np.testing.assert_array_equal(frame.odometry, before.odometry)
        if frame.scan is not None:
            np.testing.assert_array_equal(frame.scan.ranges, before.scan.ranges)
            np.testing.assert_array_equal(frame.scan.angles, before.scan.angles)


def returning(value, at=5):
    class Returning(Wheels):
        def process(self, frame):
            super().process(frame)
            return value if len(self.seen) > at else frame.odometry

    return Returning()


def finishing(value):
    class Finishing(Wheels):
        def finish(self):
            return value

    return Finishing()


class Raising(Wheels):
    def process(self, frame):
        return 1 / 0 if frame.stamp > 1.0 else None


class Exiting(Wheels):
    def process(self, frame):
        sys.exit(3)


class RefusingToStart(Wheels):
    def start(self, lidars, seed):
        raise KeyError("no such lidar")


class Unfinished(Wheels):
    def finish(self):
        raise RuntimeError("no memory")


class Silent(Wheels):
    def process(self, frame):
        return None


BACKWARD = Trajectory(np.array([0.3, 0.0]), np.zeros((2, 3)))
ELSEWHEN = Trajectory(np.array([1e9, 1e9 + 1.0]), np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("system", "complaint"),
    [
        (
            returning((1.0, 2.0, np.nan)),
            r"^x: after scan 1 \(0.500 s\): process returned \(1.0, 2.0, nan\), expected a",
        ),
        (
            returning(np.eye(3), at=0),
            r"scan 0 \(0.000 s\): process returned an array of shape \(3, 3\), expected a pose",
        ),
        (returning("here"), r"process returned 'here', expected a pose \(x, y, theta\) of three finite numbers"),
        (
            Raising(),
            r"scan 3 \(1.100 s\): process raised ZeroDivisionError: .*\(test_feeding.py:\d+\), expected a pose",
        ),
        (Exiting(), r"^x: scan 0 \(0.000 s\): process raised SystemExit: 3 \(test_feeding.py:\d+\), expected a pose"),
        (RefusingToStart(), r"^x: start raised KeyError: 'no such lidar'"),
        (Unfinished(), r"after scan 39: finish raised RuntimeError: no memory"),
        (Silent(), "returned no pose, neither from process nor from finish"),
        (finishing(None), r"finish returned None, expected \(Trajectory or None, OccupancyGrid or None\)"),
        (finishing((np.zeros((3, 3)), None)), "finish returned a ndarray as trajectory"),
        (finishing((None, np.zeros((3, 3)))), "finish returned a ndarray as map"),
        (
            finishing((BACKWARD, None)),
            "pose 1 at 0.000 s comes after that at 0.300 s, expected the order of the frames",
        ),
        (finishing((ELSEWHEN, None)), r"stamps \(1000000000.000 to .*\) bracket no frame .*the clock of the recording"),
    ],
)
def test_mistakes_are_one_line_that_names_system_and_scan(system, complaint):
    with pytest.raises(SystemFailedError, match=complaint) as caught:
        feed(system, "x", frames(), seed=0)
    assert "\n" not in str(caught.value)


def test_a_copy_of_the_process_that_a_system_lets_return_ends():
    """It would go on with the command as the process does, and write the same files."""

    class Forking(Wheels):
        def finish(self):
            self.child = os.fork()
            return None, None

    system, own = Forking(), os.getpid()
    try:
        feed(system, "x", frames(4), seed=0)
    finally:
        if os.getpid() != own:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(system.child, 0)[1]) == FORKED


def test_a_map_of_other_values_is_refused():
    grid = OccupancyGrid(probability=np.full((4, 4), 100.0, np.float32), resolution=0.05, origin=(0.0, 0.0, 0.0))
    with pytest.raises(SystemFailedError, match=r"the map holds 100 to 100, expected probabilities in \[0, 1\]"):
        feed(finishing((None, grid)), "x", frames(), seed=0)


def test_a_map_far_from_the_path_is_noted():
    away = OccupancyGrid(probability=GRID.probability, resolution=0.05, origin=(100.0, 0.0, 0.0))
    here, _ = feed(finishing((None, GRID)), "x", frames(), seed=0)
    there, _ = feed(finishing((None, away)), "x", frames(), seed=0)
    walls = np.where(np.indices((200, 200)).min(axis=0) < 2, 0.9, np.nan).astype(np.float32)
    walls = np.fmax(walls, walls[::-1, ::-1])
    only_walls = OccupancyGrid(probability=walls, resolution=0.05, origin=(-5.0, -5.0, 0.0))
    assert feed(finishing((None, only_walls)), "x", frames(), seed=0)[0].notes == ()
    assert here.notes == ()
    assert "only 0% of the path lies within the known part of the map" in there.notes[0]


class EveryFifth(Wheels):
    """Reports the truth of the circle at every fifth frame from the tenth on."""

    def process(self, frame):
        super().process(frame)
        k = len(self.seen) - 1
        return None if k < 10 or k % 5 else true_pose(k)


def true_pose(k):
    return frames()[k].truth


def test_poses_in_between_are_carried_by_the_odometry():
    drive = frames()
    found, _ = feed(EveryFifth(), "x", drive, seed=0)
    assert found.frames.tolist() == list(range(10, 116))  # nothing before the first and after the last pose
    np.testing.assert_array_equal(found.dense.poses[::5], [drive[k].truth for k in range(10, 116, 5)])
    truth = np.array([drive[k].truth for k in found.frames])
    assert np.abs(se2.between(truth, found.dense.poses)).max() < 0.01  # 2 % of four steps
    scans = [k for k in range(10, 116) if drive[k].scan is not None]
    np.testing.assert_array_equal(found.dense[found.at_scans].stamps, [drive[k].stamp for k in scans])


def test_the_pose_while_driving_knows_nothing_later():
    drive = frames()
    found, _ = feed(EveryFifth(), "x", drive, seed=0)
    for stamp, pose in zip(found.online.stamps, found.online.poses, strict=True):
        k = round(stamp / 0.1)
        last = k - k % 5
        expected = se2.compose(drive[last].truth, se2.between(drive[last].odometry, drive[k].odometry))
        np.testing.assert_allclose(pose, expected, atol=1e-12)


def test_a_final_trajectory_replaces_what_was_reported():
    drive = frames()
    final = Trajectory(np.array([f.stamp for f in drive]), np.array([f.truth for f in drive]))
    found, _ = feed(finishing((final, GRID)), "x", drive, seed=0)
    np.testing.assert_array_equal(found.dense.poses, final.poses)
    np.testing.assert_array_equal(found.online.poses, [f.odometry for f in drive if f.scan is not None])
    assert found.grid is GRID


def test_stamps_of_another_clock_rate_are_interpolated():
    drive = frames()
    stamps = np.arange(0.05, 11.9, 0.05)
    line = np.column_stack([stamps, 0.5 * stamps, np.zeros(len(stamps))])
    found = estimated_from("x", drive, Trajectory(stamps + 1e-4, line), None)
    np.testing.assert_allclose(found.dense.poses[:, 0], found.dense.stamps - 1e-4, atol=1e-9)
    assert "not those of the frames" in found.notes[0]


def test_stamps_that_repeat_and_step_back_find_their_frames():
    of_frames = np.array([1.0, 2.0, 2.0, 1.5, 3.0])
    assert rows_of(np.array([1.0, 2.0, 2.0, 1.5, 3.0]), of_frames).tolist() == [0, 1, 2, 3, 4]
    assert rows_of(np.array([2.0, 2.0, 1.5]), of_frames).tolist() == [1, 2, 3]
    assert rows_of(np.array([2.0, 2.0, 2.0, 2.0]), of_frames).tolist() == [1, 2, 1, 2]  # once more from the first
    assert rows_of(np.array([2.0, 2.25]), of_frames) is None


def test_cost_counts_the_time_within_the_system_only():
    class Sleeping(Wheels):
        def start(self, lidars, seed):
            super().start(lidars, seed)
            self.ballast = np.ones(4_000_000)

    drive = frames(scans=10)
    _, cost = feed(Sleeping(), "x", drive, seed=0)
    assert cost.ms_per_scan == pytest.approx(1e3 * cost.wall_s / 10)
    assert cost.memory_mb is None or cost.memory_mb > 30.0  # 4 million numbers of 8 bytes


def test_a_recording_without_scans_is_refused():
    drive = [frame for frame in frames() if frame.scan is None]
    with pytest.raises(SystemFailedError, match="no scan with beams"):
        feed(Wheels(), "x", drive, seed=0)


def test_objects_show_themselves_in_one_line():
    drive = frames(scans=10)
    system = Wheels()
    estimated, _ = feed(system, "x", drive, seed=0)
    shown = [repr(thing) for thing in (estimated, estimated.dense, GRID, drive[0], drive[0].scan, system.lidars[0])]
    assert shown[0] == "<Estimated: poses at 10 scans over 1.8 m, no map>"
    assert shown[1] == "<Trajectory: 30 poses, 2.9 s, 1.77 m>"
    assert shown[2] == "<OccupancyGrid: 200 x 200 cells of 0.05 m, 100% known, origin (-5.00, -5.00, 0.000)>"
    assert shown[4] == "<Scan 0.000 s: 180 beams, 180 hits, 0 without return>"
    assert shown[5] == "<Lidar 'laser': 180 beams, up to 20 m, mount (0.0, 0.0, 0.0)>"
    assert all(len(text) < 120 and "array" not in text for text in shown)


def test_the_filter_and_its_steps_show_themselves_in_one_line():
    mapper = GMapping(FilterConfig(particles=3))
    assert repr(mapper) == "<GMapping: 3 particles, 0 updates, at (0.000, 0.000, 0.000)>"
    first = frames(scans=1)[0]
    assert repr(mapper.process(first.odometry, first.scan)).startswith(
        "<StepReport: (0.000, 0.000, 0.000), ess 3.0 of 3,"
    )
    assert "1 updates" in repr(mapper)
