# SPDX-License-Identifier: MIT
"""Measures without truth count what is there."""

import numpy as np
import pytest

from eval.map.structure import map_structure
from tests.eval.helpers import with_wall
from tests.eval.map.truth import TRUTH, like_truth


def test_without_truth_a_second_wall_shows_as_more_of_everything():
    plain, doubled = map_structure(TRUTH), map_structure(with_wall(TRUTH, slice(20, 100), 33))
    assert doubled.occupied_share > plain.occupied_share
    assert doubled.corners == plain.corners + 2
    assert doubled.enclosed_areas == plain.enclosed_areas + 1  # 0.65 m x 4 m between the walls


def test_rooms_corners_and_crispness_are_counted():
    empty = map_structure(TRUTH)
    assert (empty.enclosed_areas, empty.corners) == (1, 4)
    assert empty.entropy_bits < 1e-6
    assert empty.known_area_m2 == pytest.approx(82 * 122 * 0.0025)
    assert empty.occupied_share == pytest.approx(404 / (82 * 122))
    divided = map_structure(with_wall(TRUTH, slice(20, 100), 80))
    assert (divided.enclosed_areas, divided.corners) == (2, 6)
    blurred = like_truth(np.where(TRUTH.known, np.clip(TRUTH.probability, 0.1, 0.9), np.nan))
    assert map_structure(blurred).entropy_bits == pytest.approx(0.469, abs=1e-3)
