# SPDX-License-Identifier: MIT
"""Each estimate of a run is scored by the same measures, under keys that name it."""

import numpy as np
import pytest

from eval.estimates import PathAndMap, named, score_estimate
from eval.scoring import Reference, score
from eval.trajectory.trajectory import Trajectory


def circle(radius: float = 5.0, noise: float = 0.0) -> Trajectory:
    angles = np.linspace(0.0, 4.0 * np.pi, 400)
    poses = np.stack([radius * np.cos(angles), radius * np.sin(angles), angles + 0.5 * np.pi], axis=1)
    poses[:, :2] += noise * np.random.default_rng(0).normal(size=(400, 2))
    return Trajectory(0.1 * np.arange(400), poses)


REFERENCE = Reference(trajectory=circle())


def test_measures_of_an_estimate_are_those_of_its_own_score():
    metrics = score_estimate("online", PathAndMap(at_scans=circle(noise=0.1)), REFERENCE, None)
    own = score(circle(noise=0.1), reference=REFERENCE)
    assert metrics == {"outcome_online": own["outcome"], "trajectory_online": own["trajectory"]}
    assert metrics["trajectory_online"]["ate_rmse_m"] == pytest.approx(0.1 * np.sqrt(2.0), rel=0.1)


def test_each_estimate_has_its_own_outcome():
    poses = circle().poses.copy()
    poses[200:, :2] += 3.0
    lost = Trajectory(circle().stamps, poses)
    assert score_estimate("filter", PathAndMap(at_scans=lost), REFERENCE, None)["outcome_filter"] == "lost"
    assert score_estimate("filter", PathAndMap(at_scans=circle()), REFERENCE, None)["outcome_filter"] == "ok"
    assert score_estimate("filter", PathAndMap(at_scans=circle()), REFERENCE, "timeout")["outcome_filter"] == "timeout"


def test_an_equal_estimate_is_named_without_the_odometry():
    metrics = score(circle(noise=0.1), reference=REFERENCE, odometry=circle(noise=0.5))
    found = named("filter", metrics)
    assert found["trajectory_filter"] == {k: v for k, v in metrics["trajectory"].items() if k != "odometry"}
    assert found["outcome_filter"] == metrics["outcome"]
    assert "map_filter" not in found
