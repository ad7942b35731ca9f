# SPDX-License-Identifier: MIT
"""A correct covariance is judged correct, an overconfident one is not; figures of a run equal those by hand."""

import json
import math

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.stats import chi2

from eval.consistency import chi_square
from eval.filter.nees import consistency, nees
from slam.se2 import compose, wrap_angle
from tests.shell import call

N = 4000
COV_X, COV_Y, COV_T = ("xx", "xy", "xt"), ("xy", "yy", "yt"), ("xt", "yt", "tt")


def table(covariance, stated, seed: int = 0, world=(0.0, 0.0, 0.0)) -> dict:
    """Poses whose errors have `covariance` (3, 3), with `stated` as their covariance; the truth seen from `world`."""
    rng = np.random.default_rng(seed)
    turns = wrap_angle(np.linspace(0.0, 40.0, N))
    truth = np.column_stack([np.linspace(0, 50, N), np.sin(np.arange(N)), turns])
    error = rng.multivariate_normal(np.zeros(3), covariance, N)
    error[0] = 0.0  # both paths start at one pose
    estimate, seen = truth + error, compose(world, truth)
    estimate[:, 2] = wrap_angle(estimate[:, 2])
    names = ("xx", "xy", "xt", "yy", "yt", "tt")
    index = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    return {
        "updated": np.ones(N),
        **dict(zip(("x", "y", "theta"), estimate.T, strict=True)),
        **{f"true_{name}": seen[:, i] for i, name in enumerate(("x", "y", "theta"))},
        **{f"cov_{name}": np.full(N, stated[i, j]) for name, (i, j) in zip(names, index, strict=True)},
    }


COVARIANCE = np.array([[0.04, 0.01, 0.002], [0.01, 0.02, -0.001], [0.002, -0.001, 0.003]])


@pytest.mark.parametrize("world", [(0.0, 0.0, 0.0), (7.0, -3.0, 2.5)])
def test_a_correct_covariance_has_a_nees_of_three(world):
    found = consistency(table(COVARIANCE, COVARIANCE, world=world))
    assert found.nees_band[0] < found.nees_mean < found.nees_band[1]
    assert found.inside_share == pytest.approx(0.95, abs=0.01)
    assert (found.steps, found.degenerate) == (N, 0)


def test_a_covariance_four_times_too_small_is_detected():
    found = consistency(table(COVARIANCE, COVARIANCE / 4.0))
    assert found.nees_mean == pytest.approx(12.0, rel=0.05)
    assert found.nees_mean > found.nees_band[1]
    assert found.inside_share < 0.6


@pytest.mark.parametrize("share", [0.025, 0.5, 0.95, 0.975])
@pytest.mark.parametrize("freedom", [1, 3, 1500])
def test_quantiles_equal_those_of_scipy(share, freedom):
    assert chi_square(share, freedom) == pytest.approx(chi2.ppf(share, freedom), rel=1e-9)


def test_particles_at_one_pose_have_no_covariance_to_judge():
    steps = table(COVARIANCE, COVARIANCE)
    for name in ("xx", "xy", "xt", "yy", "yt", "tt"):
        steps[f"cov_{name}"][: N // 2] = 0.0
    rows, values, degenerate = nees(steps)
    assert (len(rows), len(values), degenerate) == (N // 2, N // 2, N // 2)


def test_without_truth_there_is_no_consistency():
    steps = table(COVARIANCE, COVARIANCE) | {f"true_{name}": [None] * N for name in ("x", "y", "theta")}
    assert consistency(steps) is None


@pytest.mark.slow
def test_figures_of_a_run_equal_a_calculation_by_hand(tmp_path):
    """Row by row from the files, with plain formulas and scipy's quantiles."""
    short = ("--backend", "fast", "--particles", "10", "--duration", "25")
    assert call("run", "office", *short, "--out", tmp_path / "run") == 0
    rows = [row for row in pq.read_table(tmp_path / "run" / "steps.parquet").to_pylist() if row["updated"]]
    stated = json.loads((tmp_path / "run" / "metrics.json").read_text())["filter"]
    first = rows[0]
    turn = first["theta"] - first["true_theta"]
    values = []
    for row in rows:
        dx, dy = row["true_x"] - first["true_x"], row["true_y"] - first["true_y"]
        error = [
            row["x"] - first["x"] - (math.cos(turn) * dx - math.sin(turn) * dy),
            row["y"] - first["y"] - (math.sin(turn) * dx + math.cos(turn) * dy),
            math.remainder(row["theta"] - row["true_theta"] - turn, 2.0 * math.pi),
        ]
        covariance = np.array([[row[f"cov_{name}"] for name in names] for names in (COV_X, COV_Y, COV_T)])
        if np.linalg.eigvalsh(covariance)[0] > 1e-8:
            values.append(float(error @ np.linalg.inv(covariance) @ error))
    k = len(values)
    stated_nees = stated["consistency"]
    assert stated_nees["steps"] == k > 50
    assert stated_nees["nees_mean"] == pytest.approx(np.mean(values), rel=1e-6)
    assert stated_nees["nees_band"] == pytest.approx([chi2.ppf(0.025, 3 * k) / k, chi2.ppf(0.975, 3 * k) / k])
    assert stated_nees["inside_share"] == pytest.approx(np.mean(np.array(values) < chi2.ppf(0.95, 3)))
    assert stated["mean_ess"] == pytest.approx(np.mean([row["ess"] for row in rows]))
    assert stated["resamplings"] == sum(row["resampled"] for row in rows)
    assert stated["match_failures"] == sum(row["match_failures"] for row in rows)
