# SPDX-License-Identifier: MIT
"""Proper scores and calibration have their known values."""

import numpy as np
import pytest

from eval.map.probability import CLIP, probability_score
from tests.eval.helpers import with_wall
from tests.eval.map.truth import CELLS, EVERYWHERE, TRUTH, WALLS, like_truth

SURE = -np.log(1.0 - CLIP)


def test_each_fault_costs_what_its_cells_cost_in_every_score():
    missing = with_wall(TRUTH, slice(20, 100), 19, np.nan)
    erased = with_wall(TRUTH, slice(20, 100), 19, 0.0)
    invented = with_wall(TRUTH, slice(20, 100), 80)
    shifted = with_wall(erased, slice(20, 100), 20)
    for grid, unknown, wrong, auc in (
        (missing, 80, 0, 1.0),
        (erased, 0, 80, 1.0 - 0.5 * 80 / WALLS),  # a wall cell ties with every free one
        (invented, 0, 80, 1.0 - 0.5 * 80 / (CELLS - WALLS)),
        (shifted, 0, 160, None),
    ):
        found = probability_score(grid, TRUTH, EVERYWHERE)
        right = CELLS - unknown - wrong
        assert found.log_loss == pytest.approx((unknown * np.log(2) - wrong * np.log(CLIP) + right * SURE) / CELLS)
        assert found.brier == pytest.approx((unknown / 4 + wrong * (1 - CLIP) ** 2 + right * CLIP**2) / CELLS)
        if auc is not None:
            assert found.auc == pytest.approx(auc)
    # Where the map says wall, 404 of 484 cells are one: the gap weighs as much as the cells that state it.
    gap = abs((1.0 - CLIP) - WALLS / (WALLS + 80)) * (WALLS + 80) + CLIP * (CELLS - WALLS - 80)
    assert probability_score(invented, TRUTH, EVERYWHERE).calibration_error == pytest.approx(gap / CELLS)


def test_a_map_that_knows_nothing_scores_ln_2_and_a_quarter():
    score = probability_score(like_truth(np.full(TRUTH.probability.shape, np.nan)), TRUTH, EVERYWHERE)
    assert score.log_loss == pytest.approx(np.log(2.0))
    assert score.brier == 0.25
    assert score.auc == 0.5


def test_calibration_separates_right_from_overconfident_maps():
    rng = np.random.default_rng(2)
    p = rng.choice([0.1, 0.3, 0.7], size=(400, 400))
    truth = like_truth(rng.random(p.shape) < p)
    honest = probability_score(like_truth(p), truth, truth.known)
    assert honest.calibration_error < 0.005
    assert [round(part.stated, 2) for part in honest.calibration] == [0.1, 0.3, 0.7]
    sure = probability_score(like_truth(np.where(p < 0.5, 0.0, 1.0)), truth, truth.known)
    assert sure.calibration_error == pytest.approx((0.1 + 0.3 + 0.3) / 3.0, abs=0.01)
    assert sure.log_loss > honest.log_loss


def test_auc_is_the_share_of_pairs_in_the_right_order():
    truth = like_truth([[1.0, 1.0, 0.0, 0.0]])
    score = probability_score(like_truth([[0.9, 0.4, 0.4, 0.1]]), truth, truth.known)
    assert score.auc == pytest.approx((2 + 1.5) / 4)
    assert probability_score(truth, like_truth([[1.0, 1.0, 1.0, 1.0]]), truth.known).auc is None
