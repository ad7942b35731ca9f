# SPDX-License-Identifier: MIT
"""The bound on the error of a path: where the answer is known, and against a matrix that is written down whole."""

import math

import numpy as np
import pytest

from slam import se2
from slam.scan import Scan
from testbed.frame import Frame
from testbed.presets.models import LidarPreset
from testbed.simulation import OdometryConfig
from tools.measure.cramer_rao import FREE, HELD, Beams, bound, cast, row, seen_beams, true_steps

SPREAD = np.array([0.02, 0.03, 0.003])


def chained(motions):
    """Poses (n + 1, 3) after motions (n, 3), from (0.3, 0.2, 0.1)."""
    poses = [np.array([0.3, 0.2, 0.1])]
    for motion in motions:
        poses.append(se2.compose(poses[-1], motion))
    return np.array(poses)


def beams_at(poses, walls, angles, sigma=0.01):
    """Beams of a lidar at all poses, whose ends err by sigma across their wall."""
    parts = []
    for number, pose in enumerate(poses):
        ranges, wall = cast(pose, angles, walls)
        met = np.isfinite(ranges)
        direction = np.stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)], axis=1)[met]
        parts.append((np.full(met.sum(), number), wall[met], pose[:2] + ranges[met, None] * direction))
    pose, wall, end = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Beams(pose, wall, end, np.full(len(pose), sigma**-2.0), np.full(len(pose), np.inf))


def test_along_a_corridor_without_ends_odometry_is_all_there_is():
    steps = np.tile([0.1, 0.0, 0.0], (200, 1))
    poses = np.column_stack([np.arange(201) * 0.1, np.zeros((201, 2))])
    walls = np.array([(-500.0, 1.0, 500.0, 1.0), (-500.0, -1.2, 500.0, -1.2)])
    config = OdometryConfig()
    beams = beams_at(poses, walls, np.radians([60.0, 90.0, 120.0, -60.0, -90.0, -120.0]))
    x = np.sqrt(bound(poses, true_steps(steps, config), beams, walls, SPREAD)[:, 0, 0])
    way = poses[:, 0]
    expected = np.hypot(config.random_translation * np.sqrt(way), SPREAD[0] * way)
    np.testing.assert_allclose(x, expected, rtol=1e-3, atol=1e-5)
    assert expected[-1] == pytest.approx(0.40, abs=0.01)


def test_a_wall_ahead_shows_how_far_the_robot_came():
    """By two ranges of a wall, first and last: what they err, whatever odometry errs."""
    steps, sigma = np.tile([0.1, 0.0, 0.0], (20, 1)), 0.01
    poses = np.column_stack([np.arange(21) * 0.1, np.zeros((21, 2))])
    walls = np.array([(5.0, -50.0, 5.0, 50.0)])
    first_and_last = beams_at(poses, walls, np.array([0.0]), sigma)
    kept = np.isin(first_and_last.pose, (0, 20))
    beams = Beams(*(column[kept] for column in first_and_last))
    far = true_steps(steps, OdometryConfig(random_translation=10.0))
    x = bound(poses, far, beams, walls, SPREAD)[-1, 0, 0]
    assert math.sqrt(x) == pytest.approx(math.sqrt(2.0) * sigma, rel=1e-3)


def residuals(unknowns, poses, steps, prior, beams, walls, middle):
    """All errors by their standard deviations; unknowns: poses, systematic errors, offsets and turns of the walls."""
    n = len(poses)
    at, wheels, offsets = unknowns[: 3 * n].reshape(n, 3), unknowns[3 * n : 3 * n + 3], unknowns[3 * n + 3 :]
    out = [np.sqrt(HELD) * (at[0] - poses[0]), wheels / SPREAD, np.sqrt(FREE) * offsets]
    for t, (dx, dy, turn) in enumerate(steps):
        a, b, c = wheels
        meant = np.array([(1.0 + a) * dx, (1.0 + a) * dy, (1.0 + b) * turn + c * dx])
        error = se2.between(se2.compose(at[t], meant), at[t + 1])
        out.append(np.sqrt(prior.precision[t, 0]) * error)
    for pose, wall, end, weight, _ in zip(*beams, strict=True):
        seen = se2.transform_points(at[pose], se2.transform_points(se2.inverse(poses[pose]), end[None]))[0]
        angle = math.atan2(*(walls[wall, 3:1:-1] - walls[wall, 1::-1])) + offsets[2 * wall + 1]
        normal = np.array([-math.sin(angle), math.cos(angle)])
        out.append([math.sqrt(weight) * (normal @ (seen - middle[wall]) - offsets[2 * wall])])
    return np.concatenate(out)


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_is_the_inverse_of_the_whole_information(seed):
    rng = np.random.default_rng(seed)
    steps = rng.normal(loc=(0.3, 0.0, 0.1), scale=(0.1, 0.02, 0.2), size=(6, 3))
    poses = chained(steps)
    walls = np.array([(-5.0, -3.0, 6.0, -2.5), (6.0, -2.5, 5.0, 4.0), (5.0, 4.0, -5.0, 3.0)])
    beams = beams_at(poses, walls, rng.uniform(-math.pi, math.pi, 12), 0.02)
    prior = true_steps(steps, OdometryConfig())
    middle = 0.5 * (walls[:, :2] + walls[:, 2:])
    at = np.concatenate([poses.ravel(), np.zeros(3 + 2 * len(walls))])
    step = 1e-6
    J = np.stack(
        [
            (
                residuals(at + h, poses, steps, prior, beams, walls, middle)
                - residuals(at - h, poses, steps, prior, beams, walls, middle)
            )
            / (2.0 * step)
            for h in step * np.eye(len(at))
        ],
        axis=1,
    )
    whole = np.linalg.inv(J.T @ J)
    found = bound(poses, prior, beams, walls, SPREAD)
    for k in range(1, len(poses)):
        expected = whole[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        np.testing.assert_allclose(found[k], expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


def test_without_readings_near_corners_jambs_say_nothing_from_afar():
    """A face of 12 cm across a corridor, seen with a range noise of 1 %: from 10 m every reading is near a corner."""
    lidar = LidarPreset(
        name="l", title="l", source="s", beams=2880, field_of_view_deg=360.0, scan_rate=10.0, range_min=0.1,
        range_max=12.0, noise_floor=0.005, noise_share=0.01,
    )  # fmt: skip
    walls = np.array([(10.0, -0.06, 10.0, 0.06)])
    kept = []
    for x in (0.0, 8.5):
        pose, angles = np.array([x, 0.0, 0.0]), lidar.angles(lidar.beams)
        ranges, _ = cast(pose, angles, walls)
        scan = Scan(ranges=np.minimum(ranges, 20.0), angles=angles, range_max=12.0)
        beams = seen_beams([Frame(stamp=0.0, odometry=pose, scan=scan, truth=pose)], walls, lidar)
        assert len(beams.pose) > 4
        np.testing.assert_allclose(beams.weight, np.maximum(0.005, 0.01 * (10.0 - x)) ** -2.0, rtol=1e-3)
        kept.append(len(beams.away_from_corners().pose) / len(beams.pose))
    assert kept[0] == 0.0
    assert kept[1] == pytest.approx(0.5, abs=0.1)


def test_a_row_has_root_mean_squares_and_the_ratios_of_the_drives():
    drives = [(0.03, 0.02, 0.05), (0.04, 0.02, 0.05)]
    assert row("hall", drives) == "| hall | 2 | 35.4 mm | 20.0 mm | 50.0 mm | 1.77 | 1.5 to 2.0 |"
