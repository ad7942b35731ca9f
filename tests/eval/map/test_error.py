# SPDX-License-Identifier: MIT
"""All measures of a map together: each fault changes those that it should, and no others."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.map.error import map_error
from eval.map.grids import resample
from eval.map.overlap import coverage, free_overlap, occupied_overlap
from eval.map.probability import CLIP, probability_score
from eval.map.structure import map_structure
from eval.map.walls import wall_distances, wall_profile
from slam.occupancy import OccupancyGrid
from slam.se2 import inverse
from tests.eval.helpers import moved, room, with_wall
from tests.eval.map.truth import EVERYWHERE, IDENTITY, TRUTH, like_truth


def test_the_truth_itself_has_the_best_score_of_every_measure():
    for tolerance in (0, 1, 2):
        assert occupied_overlap(TRUTH, TRUTH, EVERYWHERE, tolerance=tolerance).iou == 1.0
        assert free_overlap(TRUTH, TRUTH, EVERYWHERE, tolerance=tolerance).f1 == 1.0
    there, back = wall_distances(TRUTH, TRUTH, IDENTITY, EVERYWHERE)
    assert there.mean == back.p95 == 0.0
    profile = wall_profile(TRUTH, TRUTH, IDENTITY, EVERYWHERE)
    assert profile.double_wall_rate == profile.missing_wall_rate == 0.0
    assert profile.wall_thickness_m == profile.true_wall_thickness_m == pytest.approx(0.05)
    score = probability_score(TRUTH, TRUTH, EVERYWHERE)
    assert score.log_loss == pytest.approx(-np.log(1.0 - CLIP))
    assert score.auc == 1.0
    assert coverage(TRUTH, EVERYWHERE) == 1.0


@pytest.mark.parametrize("cells", [1, 2, 5])
def test_a_wall_shifted_by_d_is_at_distance_d(cells):
    truth = with_wall(like_truth(np.zeros((60, 60))), 30, slice(None))
    shifted = moved(truth, (0.0, cells * 0.05, 0.0))
    there, back = wall_distances(shifted, truth, IDENTITY, truth.known)
    for distance in (there.mean, there.trimmed_mean, there.p95, back.mean):
        assert distance == pytest.approx(cells * 0.05)
    drawn = resample(shifted, truth, IDENTITY)
    assert occupied_overlap(drawn, truth, truth.known, tolerance=cells - 1).f1 == 0.0
    assert occupied_overlap(drawn, truth, truth.known, tolerance=cells).f1 == 1.0


def test_a_missing_wall_lowers_recall_and_distance_from_truth():
    missing = with_wall(TRUTH, slice(20, 100), 19, np.nan)
    overlap = occupied_overlap(missing, TRUTH, EVERYWHERE)
    walls = int(TRUTH.occupied.sum())
    assert overlap.precision == 1.0
    assert overlap.recall == pytest.approx((walls - 80) / walls)
    there, back = wall_distances(missing, TRUTH, IDENTITY, EVERYWHERE)
    assert there.mean == 0.0
    # Row r of the missing wall is min(r + 1, 80 - r) cells away from the nearest corner that stands.
    assert back.mean == pytest.approx(2 * sum(range(1, 41)) * 0.05 / walls)
    assert wall_profile(missing, TRUTH, IDENTITY, EVERYWHERE).missing_wall_rate == pytest.approx(0.2, abs=0.06)


def test_an_invented_wall_lowers_precision_and_distance_to_truth():
    invented = with_wall(TRUTH, slice(20, 100), 80)
    overlap = occupied_overlap(invented, TRUTH, EVERYWHERE)
    walls = int(TRUTH.occupied.sum())
    assert overlap.recall == 1.0
    assert overlap.precision == pytest.approx(walls / (walls + 80))
    assert overlap.iou == pytest.approx(walls / (walls + 80))
    there, back = wall_distances(invented, TRUTH, IDENTITY, EVERYWHERE)
    assert back.mean == 0.0
    assert there.mean == pytest.approx(2 * sum(range(1, 41)) * 0.05 / (walls + 80))


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_what_lies_off_the_true_map_counts_by_its_area(resolution):
    # The whole room far away: all of its walls are wrong, whatever the size of its cells.
    elsewhere = moved(room(resolution=resolution), (100.0, 0.0, 0.0))
    both = room()
    error = map_error(elsewhere, both, IDENTITY, EVERYWHERE)
    assert error.occupied[0].precision == 0.0
    assert error.occupied[2].f1 == 0.0
    assert error.free[0].precision == 0.0
    assert error.coverage == 0.0
    assert error.wall_distance > 90.0
    half = OccupancyGrid(
        probability=np.concatenate([TRUTH.probability, TRUTH.probability], axis=1),
        resolution=TRUTH.resolution,
        origin=TRUTH.origin,
    )
    assert map_error(half, TRUTH, IDENTITY, EVERYWHERE).occupied[0].precision == pytest.approx(0.5)


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-3.1, 3.1))
@settings(max_examples=25, deadline=None)
def test_a_moved_map_scores_as_before_under_its_alignment(x, y, theta):
    there, back = wall_distances(moved(TRUTH, (x, y, theta)), TRUTH, inverse([x, y, theta]), EVERYWHERE)
    assert there.mean < 1e-9
    assert back.mean < 1e-9


@pytest.mark.parametrize("resolution", [0.025, 0.05, 0.1])
def test_other_resolutions_are_drawn_on_the_true_cells(resolution):
    other = room(resolution=resolution)
    drawn = resample(other, TRUTH, IDENTITY)
    middle = round(4.0 / resolution)  # a column inside the room, x = 3 m
    wall = with_wall(other, slice(round(1.5 / resolution), round(4.5 / resolution)), middle)
    assert (resample(wall, TRUTH, IDENTITY).occupied[30:90, 80]).all()
    assert free_overlap(drawn, TRUTH, EVERYWHERE).recall > 0.94
    assert occupied_overlap(drawn, TRUTH, EVERYWHERE, tolerance=1).f1 == pytest.approx(1.0, abs=0.02)


def test_maps_without_known_cells_or_walls_have_no_score():
    unknown = like_truth(np.full(TRUTH.probability.shape, np.nan))
    assert map_structure(unknown) is None
    assert wall_distances(unknown, TRUTH, IDENTITY, EVERYWHERE) is None
    assert occupied_overlap(unknown, TRUTH, EVERYWHERE).iou == 0.0
    assert coverage(unknown, EVERYWHERE) == 0.0
    profile = wall_profile(unknown, TRUTH, IDENTITY, EVERYWHERE)
    assert (profile.missing_wall_rate, profile.double_wall_rate, profile.wall_thickness_m) == (1.0, None, None)
    assert probability_score(TRUTH, unknown, unknown.known) is None
