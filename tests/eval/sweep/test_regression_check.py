# SPDX-License-Identifier: MIT
"""The regression gate: silent about noise, loud about what got worse."""

import json

import numpy as np
import pytest

from eval.sweep.regression_check import BaselineError, compare_with_baseline, write_baseline
from eval.sweep.results import read_sweep
from tests.eval.synthetic_sweep import COUNTS, LINES, PLACES, write_sweep

SEEDS = 4
SHAPE = (len(PLACES), len(LINES), len(COUNTS), SEEDS)


def table_of(folder, errors: np.ndarray):
    return read_sweep(write_sweep(folder, lambda *index: float(errors[index]), seeds=SEEDS))


def noisy(seed: int, spread: float = 0.15) -> np.ndarray:
    return 0.03 * np.exp(spread * np.random.default_rng(seed).normal(size=SHAPE))


@pytest.fixture
def baseline(tmp_path):
    path = tmp_path / "baseline.json"
    write_baseline(table_of(tmp_path / "base", noisy(0)), path)
    return path


def test_the_same_sweep_is_as_before(tmp_path, baseline):
    comparisons = compare_with_baseline(table_of(tmp_path / "same", noisy(0)), baseline)
    assert len(comparisons) == len(PLACES) * len(LINES) * len(COUNTS) + len(LINES)
    assert [c.factor for c in comparisons] == pytest.approx([1.0] * len(comparisons), abs=1e-4)
    assert not any(c.worse or c.better for c in comparisons)


def test_other_seeds_hardly_ever_raise_an_alarm(tmp_path):
    """Of 60 pairs of sweeps that differ in their seeds alone at most 1 in 100 may: 3 alarms have a chance of 2 %."""
    alarms, path = 0, tmp_path / "baseline.json"
    for seed in range(60):
        write_baseline(table_of(tmp_path / "base", noisy(2 * seed)), path)
        alarms += any(c.worse for c in compare_with_baseline(table_of(tmp_path / "other", noisy(2 * seed + 1)), path))
    assert alarms <= 2


def test_a_line_that_is_a_quarter_worse_everywhere_fails(tmp_path, baseline):
    worse = noisy(1)
    worse[:, 1] *= 1.25
    comparisons = {c.name: c for c in compare_with_baseline(table_of(tmp_path / "worse", worse), baseline)}
    assert comparisons["motion, all together"].worse
    assert not comparisons["improved, all together"].worse


def test_one_group_that_is_twice_as_bad_fails(tmp_path, baseline):
    worse = noisy(0)
    worse[1, 0, 2] *= 2.0
    comparisons = compare_with_baseline(table_of(tmp_path / "worse", worse), baseline)
    assert next(c.name for c in comparisons if c.worse) == "cave, improved, 20 particles"


def test_what_got_better_asks_for_a_new_baseline(tmp_path, baseline):
    comparisons = compare_with_baseline(table_of(tmp_path / "better", 0.5 * noisy(0)), baseline)
    assert all(c.better for c in comparisons)
    assert not any(c.worse for c in comparisons)


def test_a_run_without_a_result_fails_and_is_no_baseline(tmp_path, baseline):
    errors = noisy(0)
    errors[0, 0, 0, 0] = np.nan
    table = table_of(tmp_path / "hole", errors)
    assert any(c.worse for c in compare_with_baseline(table, baseline))
    with pytest.raises(BaselineError, match="a run has no result"):
        write_baseline(table, tmp_path / "new.json")


def test_a_baseline_of_another_sweep_or_no_baseline_is_refused(tmp_path, baseline):
    table = table_of(tmp_path / "same", noisy(0))
    document = json.loads(baseline.read_text())
    with pytest.raises(BaselineError, match="no such file"):
        compare_with_baseline(table, tmp_path / "nowhere.json")
    for changed, complaint in (
        (document | {"groups": document["groups"][1:]}, "renew it"),
        (document | {"measure": "map.iou"}, "measures map.iou"),
        ({"groups": []}, "expected a baseline"),
        ([], "expected a baseline"),
    ):
        baseline.write_text(json.dumps(changed))
        with pytest.raises(BaselineError, match=complaint):
            compare_with_baseline(table, baseline)
