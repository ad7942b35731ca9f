# SPDX-License-Identifier: MIT
"""Cells that are right, missing or false, within a tolerance."""

import numpy as np
import pytest

from eval.map.overlap import coverage, free_overlap, occupied_overlap
from tests.eval.helpers import with_wall
from tests.eval.map.truth import CELLS, EVERYWHERE, TRUTH, WALLS


def test_walls_outside_are_false_and_unobservable_ones_not_scored():
    assert occupied_overlap(TRUTH, TRUTH, EVERYWHERE, outside=404).precision == pytest.approx(0.5)
    seen = EVERYWHERE.copy()
    seen[:, 19] = False
    without = with_wall(TRUTH, slice(None), 19, np.nan)
    for grid in (TRUTH, without):
        assert occupied_overlap(grid, TRUTH, seen).iou == 1.0


def test_unobservable_walls_in_the_map_do_not_count():
    seen = EVERYWHERE.copy()
    seen[:, 19] = False
    invented = with_wall(TRUTH, slice(20, 100), 80)
    walls = int((TRUTH.occupied & seen).sum())
    assert occupied_overlap(invented, TRUTH, seen).precision == pytest.approx(walls / (walls + 80))


def test_a_missing_wall_lowers_coverage_by_its_cells():
    missing = with_wall(TRUTH, slice(20, 100), 19, np.nan)
    assert coverage(missing, EVERYWHERE) == pytest.approx(1.0 - 80 / CELLS)
    assert free_overlap(missing, TRUTH, EVERYWHERE).f1 == 1.0
    invented = with_wall(TRUTH, slice(20, 100), 80)
    assert coverage(invented, EVERYWHERE) == 1.0
    free = CELLS - WALLS
    assert free_overlap(invented, TRUTH, EVERYWHERE).iou == pytest.approx((free - 80) / free)
