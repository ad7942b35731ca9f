# SPDX-License-Identifier: MIT
"""Where no scan tells how far the robot came: a bare corridor between two ends."""

import numpy as np
import pytest

from slam import FilterConfig, se2
from slam.refinement import joint_equations, refine
from slam.refinement.blind_stretches import along_odometry, blind_steps, by_other_scans
from slam.scan import Scan
from tests.slam.refinement.test_joint_equations import solved

HALF_WIDTH, END, REACH = 1.0, 10.0, 4.0
"""Of the corridor, whose ends lie at -END and END, and of the lidar [m]."""


def corridor(x, beams=240):
    """A scan of the corridor from (x, 0, 0), whose ranges err by a centimetre."""
    angles = np.linspace(-np.pi, np.pi, beams, endpoint=False) + 1e-3
    cos, sin = np.cos(angles), np.sin(angles)
    ranges = np.minimum(HALF_WIDTH / np.abs(sin), np.where(cos > 0.0, END - x, END + x) / np.abs(cos))
    ranges += 0.01 * np.random.default_rng(int(1e3 * (x + END))).standard_normal(beams)
    return Scan(ranges=np.where(ranges < REACH, ranges, np.inf), angles=angles, range_max=REACH)


def path_along(x):
    return np.column_stack([x, np.zeros((len(x), 2))])


@pytest.fixture(scope="module")
def slipped():
    """From one end to the other, by a path that lags by up to half a metre where the ends are out of sight."""
    x = np.arange(-9.0, 9.01, 0.1)
    truth = path_along(x)
    lagging = path_along(x - np.clip((x + 4.0) / 8.0, 0.0, 1.0) * 0.5)
    result = refine(truth, [corridor(at) for at in x], lagging, FilterConfig(), threads=1)
    return truth, result


def test_the_middle_of_a_bare_corridor_is_blind(slipped):
    truth, result = slipped
    middle = np.abs(truth[:-1, 0] + 0.05) < END - REACH
    assert result.blind[middle].mean() > 0.95
    assert not result.blind[np.abs(truth[:-1, 0] + 0.05) > END - REACH + 0.3].any()


def test_the_path_along_the_odometry_does_not_slip(slipped):
    """Where the pass had left half a metre, the other start has the odometry's distance."""
    truth, result = slipped
    other = result.along_odometry(truth)
    step, moved = np.diff(other[:, 0]), np.diff(result.poses[:, 0])
    np.testing.assert_allclose(step[result.blind], 0.1 * (1.0 + result.odometry_correction[0]), rtol=1e-3)
    np.testing.assert_allclose(step[~result.blind], moved[~result.blind])


def test_headings_stay_and_displacements_turn_with_them():
    poses = np.array([(1.0, 2.0, 0.5), (1.5, 2.0, 2.0), (1.5, 3.0, 2.5), (2.0, 3.0, 0.0)])
    motions = np.array([(0.3, 0.1, 9.0), (0.2, 0.0, 9.0), (0.4, 0.0, 9.0)])
    path = along_odometry(poses, motions, np.array([True, False, True]))
    np.testing.assert_array_equal(path[:, 2], poses[:, 2])
    moved = se2.between(path[:-1], path[1:])[:, :2]
    np.testing.assert_allclose(moved[[0, 2]], motions[[0, 2], :2], atol=1e-12)
    np.testing.assert_allclose(path[2, :2] - path[1, :2], poses[2, :2] - poses[1, :2], atol=1e-12)


def test_short_stretches_do_not_count():
    """Scans that see the end of a corridor on both sides of a metre that they do not see."""
    x = np.concatenate([np.arange(-9.0, -5.5, 0.1), np.arange(-5.5, -4.8, 0.1)])
    result = refine(path_along(x), [corridor(at) for at in x], path_along(x), FilterConfig(), threads=1)
    assert not result.blind.any()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("at_once", [1, 7, 10**6])
def test_what_other_scans_say_is_less_than_what_walls_would(monkeypatch, seed, at_once):
    """The diagonal blocks of the equations whose walls follow, written down whole, from so many blocks at a time."""
    monkeypatch.setattr(joint_equations, "OBSERVATIONS_AT_ONCE", at_once)
    adjustment, _ = solved(seed)
    e = adjustment.solved.equations
    found = by_other_scans(e, adjustment.seen)
    for i, (begin, end) in enumerate(zip(e.observations.first[:-1], e.observations.first[1:], strict=True)):
        expected = adjustment.seen[i].copy()
        for k in range(begin, end):
            unknown = e.observations.surfel[k]
            b = np.append(e.observations.weight[k] * e.normal[unknown], e.observations.heading_jacobian[k])
            expected -= np.outer(b, b) / e.total[unknown]
        np.testing.assert_allclose(found[i], expected, rtol=1e-9, atol=1e-6)
        assert np.linalg.eigvalsh(found[i])[0] > -1e-6 * np.trace(found[i])
        assert np.linalg.eigvalsh(adjustment.seen[i] - found[i])[0] > -1e-6 * np.trace(found[i])


def test_a_room_is_nowhere_blind():
    adjustment, _ = solved(0)
    assert not blind_steps(adjustment.solved.equations, adjustment.seen).any()
