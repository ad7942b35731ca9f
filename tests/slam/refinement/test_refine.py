# SPDX-License-Identifier: MIT
"""The final pass: paths that a filter might give, in a room of which every scan is known."""

import numpy as np
import pytest

from slam import FilterConfig, refine, se2
from slam.config import RefineConfig
from slam.refinement.progress import LOOPS_SHARE, ROUNDS_SHARE
from tests.slam.rooms import drive, noisy_odometry, scan_at

CONFIG = FilterConfig()


@pytest.mark.parametrize("seed", range(3))
def test_final_pass_mends_a_noisy_path(seed):
    """Exact scans, odometry with noise, a first guess as a filter gives it; every second frame has odometry alone."""
    rng = np.random.default_rng(seed)
    truth = drive(24, distance=0.15, turn=0.08)
    odometry = noisy_odometry(truth, rng)
    scans = [scan_at(pose, beams=120) if k % 2 == 0 else None for k, pose in enumerate(truth)]
    initial = truth + rng.normal(scale=(0.04, 0.04, 0.02), size=truth.shape)
    initial[0] = truth[0]
    result = refine(odometry, scans, initial, CONFIG, threads=1)
    before, after = (poses - truth for poses in (initial, result.poses))
    assert np.linalg.norm(after[:, :2]) < 0.6 * np.linalg.norm(before[:, :2])
    assert np.linalg.norm(after[:, 2]) < 0.6 * np.linalg.norm(before[:, 2])
    np.testing.assert_allclose(result.poses[0], initial[0], atol=1e-6)  # it defines the frame
    again = refine(odometry, scans, initial, CONFIG, threads=3)
    np.testing.assert_array_equal(again.poses, result.poses)
    np.testing.assert_array_equal(again.map.probability, result.map.probability)


@pytest.mark.parametrize("off", [(0.06, -0.04, 0.0), (0.0, 0.05, 0.03)])
def test_the_first_pose_comes_into_step_with_the_others(off):
    """A filter errs at its first pose as at any other; in the frame of that pose the whole path must be right after."""
    truth = drive(16, distance=0.15, turn=0.08)
    initial = truth.copy()
    initial[0] = se2.compose(truth[0], off)
    result = refine(truth, [scan_at(pose, beams=120) for pose in truth], initial, CONFIG, threads=1)
    np.testing.assert_allclose(result.poses[0], initial[0], atol=1e-9)
    seen_from_first = [se2.between(poses[0], poses) for poses in (initial, truth, result.poses)]
    wrong, right, found = seen_from_first
    assert np.abs(wrong - right)[1:, :2].max() > 0.04
    np.testing.assert_allclose(found, right, atol=0.015)


def test_final_pass_leaves_a_perfect_path_alone():
    truth = drive(6)
    result = refine(truth, [scan_at(pose) for pose in truth], truth, CONFIG, threads=1)
    np.testing.assert_allclose(result.poses, truth, atol=0.01)


def test_final_pass_says_what_does_not_fit():
    scan = scan_at(np.zeros(3))
    with pytest.raises(ValueError, match="one length, got 2, 1, 2"):
        refine(np.zeros((2, 3)), [scan], np.zeros((2, 3)), CONFIG)
    with pytest.raises(ValueError, match="must be finite"):
        refine(np.zeros((1, 3)), [scan], np.full((1, 3), np.nan), CONFIG)
    with pytest.raises(ValueError, match="no frame has a scan with a hit"):
        refine(np.zeros((2, 3)), [None, None], np.zeros((2, 3)), CONFIG)


@pytest.mark.parametrize(("frames", "beams"), [(1, 60), (2, 60), (3, 1), (3, 2)])
def test_recordings_with_next_to_nothing_in_them_stay_as_they_are(frames, beams):
    """One frame, two frames, scans with too few hits for a line."""
    poses = drive(frames - 1, distance=0.1)
    result = refine(poses, [scan_at(pose, beams=beams) for pose in poses], poses, CONFIG, threads=1)
    np.testing.assert_allclose(result.poses, poses, atol=0.01)
    assert result.map.occupied.any()


def test_who_watches_sees_the_share_grow_and_may_end_the_pass():
    """With the rounds so far: ended after two, the result is that of two rounds; never fewer than one is made."""
    rng = np.random.default_rng(1)
    truth = drive(300, distance=0.02, turn=0.01)
    odometry, scans = noisy_odometry(truth, rng), [scan_at(pose, beams=40) for pose in truth]
    two = FilterConfig(refine=RefineConfig(rounds=2))
    shares = []

    def until_second_round(share):
        shares.append(share)
        return share < LOOPS_SHARE + 1.5 * ROUNDS_SHARE / CONFIG.refine.rounds

    ended = refine(odometry, scans, odometry, CONFIG, threads=1, watch=until_second_round)
    assert ended.rounds == 2
    np.testing.assert_array_equal(ended.poses, refine(odometry, scans, odometry, two, threads=1).poses)
    assert shares == sorted(shares)
    assert shares[0] < LOOPS_SHARE
    assert LOOPS_SHARE + ROUNDS_SHARE < shares[-1] <= 1.0
    assert refine(odometry, scans, odometry, CONFIG, threads=1, watch=lambda share: False).rounds == 1
