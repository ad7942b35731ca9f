# SPDX-License-Identifier: MIT
"""The moment at which a run went wrong, found from truth, relations or the table of steps."""

from __future__ import annotations

import numpy as np

from eval.first_failure import find_failure, first_bad_match, first_bad_stretch
from eval.trajectory.relations import Relations
from eval.trajectory.trajectory import Trajectory
from slam.se2 import between


def test_the_first_bad_stretch_is_where_the_path_was_bent():
    x = 0.1 * np.arange(300)
    truth = Trajectory(x, np.column_stack([x, 0.0 * x, 0.0 * x]))
    bent = truth.poses.copy()
    bent[120:, 1] += 0.3
    failure = first_bad_stretch(Trajectory(x, bent), truth)
    assert (failure.bad, failure.scan, failure.since) == (True, 120, 110)
    np.testing.assert_allclose(failure.estimated, bent[120])
    np.testing.assert_allclose(failure.true_pose, truth.poses[120])
    fine = first_bad_stretch(truth, truth)
    assert not fine.bad
    assert first_bad_stretch(truth[:5], truth[:5]) is None


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
