# SPDX-License-Identifier: MIT
"""The moment at which a run went wrong, found from truth, relations or the table of steps."""

from __future__ import annotations

import numpy as np
import pytest

from eval.files.failure_json import read_failure, write_failure
from eval.first_failure import BAD_DEG, BAD_M, find_failure, first_bad_match, first_bad_stretch
from eval.trajectory.relations import Relations
from eval.trajectory.trajectory import Trajectory
from slam.se2 import between, compose


def straight(n: int = 300, step: float = 0.1) -> Trajectory:
    """A straight true path, 0.1 s between poses."""
    x = step * np.arange(n)
    return Trajectory(0.1 * np.arange(n), np.column_stack([x, 0.0 * x, 0.0 * x]))


def jumped(truth: Trajectory, at: int, motion: list[float]) -> np.ndarray:
    """Poses of an estimate that goes on from another pose from row `at` on."""
    poses = truth.poses.copy()
    poses[at:] = compose(compose(poses[at], motion), between(poses[at], poses[at:]))
    return poses


@pytest.mark.parametrize("motion", [[0.0, 0.4, 0.0], [0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [3.0, -2.0, 2.0]])
def test_the_moment_is_the_jump_from_which_nothing_comes_back(motion):
    truth = straight()
    failure = first_bad_stretch(Trajectory(truth.stamps, jumped(truth, 120, motion)), truth)
    assert failure.bad
    assert abs(failure.scan - 120) <= 3
    assert 108 <= failure.since < failure.scan
    assert failure.blips == ()
    assert 0 <= failure.shown_scan - failure.scan <= 30  # within 3 s
    np.testing.assert_allclose(failure.true_pose, truth.poses[failure.shown_scan])


def test_a_jump_spread_over_the_poses_between_updates_is_one_update():
    """Poses between two updates are interpolated; the moment, its size and what shows it are those of the update."""
    truth = straight()
    updated = np.arange(len(truth)) % 5 == 0
    poses = jumped(truth, 120, [0.0, 0.8, 0.0])
    poses[116:120, 1] = [0.16, 0.32, 0.48, 0.64]
    estimate, steps = Trajectory(truth.stamps, poses), {"updated": updated.astype(float)}
    assert find_failure(estimate, truth=truth).scan < 120
    failure = find_failure(estimate, truth=truth, steps=steps)
    assert (failure.scan, failure.shown_scan) == (120, 120)
    assert "with this one update it moves by 94\N{NO-BREAK SPACE}cm and 0.0 degrees, the robot by 50" in failure.reason
    np.testing.assert_allclose(failure.estimated, [12.0, 0.8, 0.0], atol=1e-9)


@pytest.mark.parametrize("turned", [110, 115])
def test_an_excursion_does_not_begin_at_a_single_turned_pose(turned: int):
    """One update is turned by less than the limit, within the metre before the jump; the next one is right again."""
    truth = straight()
    poses = truth.poses.copy()
    poses[120:160, 1] += 0.8
    poses[turned, 2] = np.radians(3.4)
    (blip,) = first_bad_stretch(Trajectory(truth.stamps, poses), truth).blips
    assert blip.stamp == pytest.approx(12.0)


def test_the_worst_pose_of_a_good_path_is_shown_and_not_a_good_one():
    """One pose is turned; it is aligned at one that is right, whichever of the two comes first."""
    truth = straight()
    poses = truth.poses.copy()
    poses[120, 2] = np.radians(10.0)
    failure = first_bad_stretch(Trajectory(truth.stamps, poses), truth)
    assert not failure.bad
    assert (failure.scan, failure.shown_scan) == (120, 120)
    np.testing.assert_allclose(failure.estimated, [12.0, 0.0, np.radians(10.0)], atol=1e-9)
    assert "10.0 degrees" in failure.reason


def test_a_blip_that_heals_is_listed_and_the_loss_after_it_is_the_moment():
    truth = straight()
    poses = jumped(truth, 200, [0.0, 0.0, 1.3])
    poses[80:82] = compose(poses[80:82], [0.1, 0.2, 0.3])
    failure = first_bad_stretch(Trajectory(truth.stamps, poses), truth)
    assert failure.bad
    assert abs(failure.scan - 200) <= 2
    (blip,) = failure.blips
    assert blip.stamp == pytest.approx(8.0, abs=0.11)
    assert blip.end < 9.5
    assert blip.degrees == pytest.approx(np.degrees(0.3), abs=0.5)


def test_a_loss_soon_after_a_blip_is_the_moment():
    truth = straight()
    poses = jumped(truth, 110, [0.0, 0.0, 1.3])
    poses[80:82] = compose(poses[80:82], [0.1, 0.2, 0.3])
    failure = first_bad_stretch(Trajectory(truth.stamps, poses), truth)
    assert failure.bad
    assert abs(failure.scan - 110) <= 2
    assert len(failure.blips) == 1


def test_a_return_from_a_warped_part_of_the_map_is_no_departure():
    """The estimate drifts into a warped part of the map, has a blip there, and comes back to where the map is right;
    metres later it is drawn into the warped part again, where it is lost."""
    truth = straight(600)
    warp = [0.2, 0.55, np.radians(5.0)]
    poses = truth.poses.copy()
    poses[100:400] = compose(truth.poses[100:400], np.minimum(np.arange(300) / 100.0, 1.0)[:, None] * warp)
    poses[390:393] = compose(poses[390:393], [0.0, 0.0, np.radians(25.0)])
    poses[450:] = compose(truth.poses[450:], warp)
    lost = compose(compose(poses[480], [0.1, 0.0, np.radians(85.0)]), between(poses[480], poses[480:]))
    poses[480:] = lost
    failure = first_bad_stretch(Trajectory(truth.stamps, poses), truth)
    assert failure.bad
    assert abs(failure.scan - 450) <= 2
    last = np.array([failure.since, failure.since + 10])
    error = between(between(*truth.poses[last]), between(*poses[last]))
    assert np.hypot(error[0], error[1]) > BAD_M or abs(np.degrees(error[2])) > BAD_DEG  # the rule of the page
    shown = between(failure.true_pose, failure.estimated)
    assert np.hypot(shown[0], shown[1]) > 0.5  # the picture shows it
    (blip,) = failure.blips
    assert blip.stamp == pytest.approx(39.0, abs=0.2)
    assert 40.0 <= blip.end <= 41.1  # within the metre that holds the return


def test_an_estimate_that_comes_back_after_metres_has_not_failed():
    truth = straight()
    poses = truth.poses.copy()
    poses[100:160, 1] += 0.8
    failure = first_bad_stretch(Trajectory(truth.stamps, poses), truth)
    assert not failure.bad
    assert failure.blips[0].stamp == pytest.approx(10.0, abs=0.11)


def test_a_right_estimate_and_one_that_drifts_have_no_moment():
    truth = straight()
    assert not first_bad_stretch(truth, truth).bad
    drift = Trajectory(truth.stamps, truth.poses * [1.01, 1.0, 1.0])
    assert not first_bad_stretch(drift, truth).bad
    assert first_bad_stretch(truth[:5], truth[:5]) is None


def test_a_loop_that_stays_open_fails_where_the_robot_comes_back():
    angle = np.linspace(0.0, 4.0 * np.pi, 800)
    poses = np.column_stack([5.0 * np.cos(angle), 5.0 * np.sin(angle), angle + 0.5 * np.pi])
    truth = Trajectory(0.1 * np.arange(800), poses)
    slow = poses + np.linspace(0.0, 1.0, 800)[:, None] * [1.5, 0.0, 0.0]  # 2 cm a metre
    failure = first_bad_stretch(Trajectory(truth.stamps, slow), truth)
    assert failure.bad
    assert 360 <= failure.scan <= 420  # the beginning of the second lap


def test_a_loop_that_is_open_because_of_an_excursion_is_named_there(tmp_path):
    """With the time of the return, also after it was written to a file; what does not come back has none."""
    angle = np.linspace(0.0, 4.0 * np.pi, 800)
    poses = np.column_stack([5.0 * np.cos(angle), 5.0 * np.sin(angle), angle + 0.5 * np.pi])
    truth = Trajectory(0.1 * np.arange(800), poses)
    off = poses.copy()
    off[100:250, 0] += 3.0
    failure = first_bad_stretch(Trajectory(truth.stamps, off), truth)
    assert failure.bad
    assert failure.stamp == pytest.approx(10.0, abs=0.2)
    assert "lies at a wrong place" in failure.reason
    assert failure.blips == ()
    assert failure.back == pytest.approx(25.0, abs=0.5)
    write_failure(tmp_path / "finding.json", failure, np.zeros((0, 2)))
    assert read_failure(tmp_path / "finding.json").failure.back == failure.back
    gone = first_bad_stretch(Trajectory(truth.stamps, jumped(truth, 100, [3.0, 0.0, 0.0])), truth)
    assert gone.bad
    assert gone.back is None


def test_without_truth_the_first_scan_off_the_map_is_found():
    n = 40
    estimate = Trajectory(np.arange(n), np.column_stack([np.arange(n), np.zeros(n), np.zeros(n)]))
    steps = {
        "updated": [True] * n,
        "stamp": list(range(n)),
        "particles": [10] * n,
        "matched_share": [0.0, *[0.9] * 19, 0.3, *[0.9] * 19],
        "match_failures": [0] * n,
    }

    def found(**changed):
        return first_bad_match(estimate, steps | changed)

    assert (found().scan, found().bad, found().estimated[0], found().true_pose) == (20, True, 20.0, None)
    failing = found(matched_share=[0.9] * n, match_failures=[0] * 30 + [6] + [0] * 9)
    assert (failing.scan, failing.bad) == (30, True)
    assert not found(matched_share=[0.9] * n).bad
    assert found(updated=[False] * n) is None


def test_with_relations_the_first_broken_one_is_found():
    x = 0.5 * np.arange(40)
    truth = Trajectory(np.arange(40.0), np.column_stack([x, 0.0 * x, 0.0 * x]))
    bent = truth.poses.copy()
    bent[25:, 1] += 0.7
    first, second = np.array([20, 30, 10, 5]), np.array([24, 34, 26, 38])  # the last two straddle the bend
    for one, two in ((first, second), (second, first)):  # relations may look back in time
        relations = Relations(truth.stamps[one], truth.stamps[two], between(truth.poses[one], truth.poses[two]))
        failure = find_failure(Trajectory(truth.stamps, bent), relations=relations)
        assert (failure.scan, failure.since, failure.bad) == (26, 10, True)
        np.testing.assert_allclose(failure.estimated, bent[26])
        np.testing.assert_allclose(failure.true_pose, truth.poses[26])
        assert "70\xa0cm" in failure.reason
        assert find_failure(truth, relations=relations) is None


def test_a_jump_there_and_back_while_the_map_drifts_is_not_the_moment():
    truth = straight(600)
    bend = np.column_stack([np.zeros(600), np.clip(0.008 * (np.arange(600) - 100), 0.0, 2.0), np.zeros(600)])
    poses = truth.poses + bend
    poses[150:152] = compose(poses[150:152], [0.0, 0.0, np.radians(40.0)])
    poses[400:] = compose(compose(poses[400], [0.0, 0.0, 1.3]), between(poses[400], poses[400:]))
    failure = first_bad_stretch(Trajectory(truth.stamps, poses), truth)
    assert failure.bad
    assert abs(failure.scan - 400) <= 2
    assert [round(blip.stamp) for blip in failure.blips] == [15]
    alone = first_bad_stretch(Trajectory(truth.stamps[:390], poses[:390]), truth)
    assert abs(alone.scan - 150) <= 2  # without a loss after it, it is the moment from which nothing comes back


def test_a_loss_that_touches_the_way_back_from_another_one_is_the_moment():
    """It is lost for 6 m of path, back where the map is right for 1.5 m, and lost again: first a passing error."""
    truth = straight(600)
    poses = jumped(truth, 200, [1.5, 0.8, 0.5])
    poses[260:] = truth.poses[260:]
    again = compose(compose(poses[275], [0.0, 2.0, 1.3]), between(poses[275], poses[275:]))
    poses[275:] = again
    failure = first_bad_stretch(Trajectory(truth.stamps, poses), truth)
    assert failure.bad
    assert abs(failure.scan - 275) <= 2
    (blip,) = failure.blips
    assert (blip.stamp, blip.end) == (pytest.approx(20.0, abs=0.2), pytest.approx(26.0, abs=0.2))
