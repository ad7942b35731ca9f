# SPDX-License-Identifier: MIT
"""A clock that differs by a constant is found, to the millisecond; errors of other kinds are not explained by it."""

import re

import numpy as np
import pytest

from eval.files.tum import write_tum
from eval.scoring import Reference, score, score_files
from eval.trajectory.association import AssociationError
from eval.trajectory.time_offset import aligned_rmse, find_time_offset
from eval.trajectory.trajectory import Trajectory
from slam.se2 import compose
from tests.eval.helpers import noisy, random_walk
from tests.eval.synthetic_run import drive

POSES = drive()
TRUTH = Trajectory(1000.0 + 0.1 * np.arange(len(POSES)), POSES)


def shifted(seconds, trajectory=TRUTH):
    return Trajectory(trajectory.stamps + seconds, trajectory.poses)


@pytest.mark.parametrize("seconds", [0.1, 0.3, -0.3, 2.0, -12.34])
def test_a_shifted_clock_is_found(seconds):
    estimate = shifted(seconds, Trajectory(TRUTH.stamps, compose([5.0, 3.0, 1.0], noisy(TRUTH, 1, 0.003).poses)))
    found = find_time_offset(estimate, TRUTH)
    assert found.seconds == pytest.approx(-seconds, abs=0.01)
    assert found.error_after < 0.01 < found.error_before


def test_a_clock_that_starts_elsewhere_is_found():
    found = find_time_offset(shifted(1.7e9)[:-80], TRUTH)
    assert found.seconds == pytest.approx(-1.7e9, abs=0.01)
    assert found.error_before is None


@pytest.mark.parametrize("seed", range(5))
def test_noise_drift_and_another_path_are_not_explained(seed):
    bent = POSES.copy()
    bent[:, 1] += 0.001 * np.arange(len(bent))
    others = random_walk(len(POSES), seed)
    for poses in (noisy(TRUTH, seed, 0.05).poses, bent, others.poses):
        assert find_time_offset(Trajectory(TRUTH.stamps + 0.01, poses), TRUTH) is None


@pytest.mark.parametrize("seconds", [0.1, 0.35, -0.35, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_shifted_clock_of_a_poor_estimate_is_found(seconds, seed):
    """An error of 5 cm hides a shift of some tenths of a second in the positions, not in the headings."""
    late = shifted(seconds, astray(seed))[::3]
    found = find_time_offset(late, TRUTH)
    assert found is not None
    assert found.seconds == pytest.approx(-seconds, abs=0.02)
    assert find_time_offset(astray(seed)[::3], TRUTH) is None
    assert find_time_offset(shifted(0.02, astray(seed))[::3], TRUTH) is None


def astray(seed):
    """The true path with a random walk of 5 cm, and headings with a noise of 0.7 degrees."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(0.0, 1.0, (len(POSES), 2)), axis=0)
    walk -= walk.mean(axis=0)
    walk *= 0.05 / np.sqrt(np.mean(np.sum(walk**2, axis=1)))
    turn = rng.normal(0.0, np.radians(0.7), len(POSES))
    return Trajectory(TRUTH.stamps, POSES + np.column_stack([walk, turn]))


def test_headings_alone_explain_nothing_where_the_positions_become_worse():
    """Headings late by 0.5 s, positions in time: no clock is late."""
    poses = POSES.copy()
    poses[5:, 2] = POSES[:-5, 2]
    assert find_time_offset(Trajectory(TRUTH.stamps + 0.01, poses), TRUTH) is None


def test_auto_says_what_it_did(tmp_path):
    write_tum(tmp_path / "truth.tum", TRUTH)
    for name, estimate in (("late", shifted(0.35, astray(0))[::3]), ("right", astray(0)[::3])):
        write_tum(tmp_path / f"{name}.tum", estimate)
    late = score_files(tmp_path, tmp_path / "late.tum")
    assert "shifted by -0.3" in late["outcome_reason"]
    mended = score_files(tmp_path, tmp_path / "late.tum", time_offset="auto")
    assert mended["outcome"] == "ok"
    assert any("stamps shifted by -0.3" in note for note in mended["notes"])
    right = score_files(tmp_path, tmp_path / "right.tum", time_offset="auto")
    (said,) = [note for note in right["notes"] if "auto" in note]
    assert said.startswith("--time-offset auto has shifted nothing: no constant offset of the clock explains the error")
    assert re.search(r"the best, -?0\.0\d\d s, leaves an error of 4\.\d\scm, 4\.\d\scm without it", said)
    assert right["trajectory"]["suggested_time_offset_s"] is None


def test_the_aligned_error_is_that_of_the_alignment():
    rng = np.random.default_rng(0)
    p, turn = rng.normal(size=(50, 2)), 0.7
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert aligned_rmse(p, p @ rotation.T + [3.0, -2.0]) < 1e-7
    assert aligned_rmse(np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([[0.0, 0.0], [0.0, 4.0]])) == pytest.approx(1.0)


def test_a_score_names_the_offset_and_a_file_is_scored_with_it(tmp_path):
    late = shifted(0.3)
    metrics = score(late, reference=Reference(trajectory=TRUTH))
    assert metrics["trajectory"]["suggested_time_offset_s"] == pytest.approx(-0.3, abs=0.002)
    assert "shifted by -0.300 s the error is 0." in metrics["outcome_reason"]
    assert any("the clocks of estimate and truth differ" in note for note in metrics["notes"])
    write_tum(tmp_path / "truth.tum", TRUTH)
    write_tum(tmp_path / "late.tum", late)
    for offset in (-0.3, "auto"):
        applied = score_files(tmp_path, tmp_path / "late.tum", time_offset=offset)
        assert applied["outcome"] == "ok"
        assert applied["trajectory"]["ate_rmse_m"] < 0.002
        assert any("stamps shifted by -0.300 s" in note for note in applied["notes"])


def test_a_clock_without_common_time_is_named_in_the_error():
    with pytest.raises(AssociationError, match=r"no pose of the estimate.* shifted by -5000\.000 s the error is"):
        score(shifted(5000.0), reference=Reference(trajectory=TRUTH))


@pytest.mark.parametrize("rows", [[0, -1], [0, 500, -1], range(4), range(len(POSES) // 100)])
def test_a_few_poses_or_a_hundredth_of_the_path_are_unjudged(rows):
    estimate = TRUTH[list(rows)]
    metrics = score(estimate, reference=Reference(trajectory=TRUTH))
    assert metrics["outcome"] == "unjudged"
    assert "expected 5 or more" in metrics["outcome_reason"] or "spans only" in metrics["outcome_reason"]


@pytest.mark.parametrize("count", [2, 3, 4])
def test_a_few_poses_of_a_short_path_are_unjudged(count):
    rows = np.linspace(0, 60, count).astype(int)  # 6 m
    metrics = score(TRUTH[rows], reference=Reference(trajectory=TRUTH[:61]))
    assert metrics["outcome"] == "unjudged"
    assert metrics["outcome_reason"] == f"{count} matched poses, expected 5 or more to judge by"


def test_ten_poses_at_both_ends_do_not_cover_the_path():
    ends = TRUTH[[*range(6), *range(-6, 0)]]
    assert score(ends, reference=Reference(trajectory=TRUTH))["outcome"] == "unjudged"
