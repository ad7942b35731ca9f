# SPDX-License-Identifier: MIT
"""Map measures on maps whose answer is known by hand: walls shifted, doubled, missing, invented; a turned map."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.map.error import map_error
from eval.map.grids import cell_centres, grid_from_true_map, lookup, resample
from eval.map.overlap import coverage, free_overlap, occupied_overlap
from eval.map.probability import CLIP, probability_score
from eval.map.structure import map_structure
from eval.map.walls import wall_distances, wall_profile
from slam.occupancy import OccupancyGrid
from slam.se2 import compose, inverse
from tests.eval.helpers import moved, room, with_wall
from worlds import TrueMap

IDENTITY = np.zeros(3)
TRUTH = room()
EVERYWHERE = TRUTH.known
ROW = 20 + 40  # a row through the middle of the room (margin of 20 cells, 80 rows of floor)


def like_truth(probability) -> OccupancyGrid:
    return OccupancyGrid(
        probability=np.asarray(probability, dtype=np.float32), resolution=TRUTH.resolution, origin=TRUTH.origin
    )


# --- the perfect map


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


# --- one wall: shifted, doubled, missing, invented


@pytest.mark.parametrize("cells", [1, 2, 5])
def test_a_wall_shifted_by_d_is_d_away_and_right_within_the_tolerance(cells):
    truth = with_wall(like_truth(np.zeros((60, 60))), 30, slice(None))
    shifted = moved(truth, (0.0, cells * 0.05, 0.0))
    there, back = wall_distances(shifted, truth, IDENTITY, truth.known)
    for distance in (there.mean, there.trimmed_mean, there.p95, back.mean):
        assert distance == pytest.approx(cells * 0.05)
    drawn = resample(shifted, truth, IDENTITY)
    assert occupied_overlap(drawn, truth, truth.known, tolerance=cells - 1).f1 == 0.0
    assert occupied_overlap(drawn, truth, truth.known, tolerance=cells).f1 == 1.0


def test_a_wall_shifted_by_less_than_a_cell_is_seen_by_the_distance():
    truth = with_wall(like_truth(np.zeros((60, 60))), 30, slice(None))
    there, back = wall_distances(moved(truth, (0.0, 0.013, 0.0)), truth, IDENTITY, truth.known)
    assert there.mean == pytest.approx(0.013)
    assert back.mean == pytest.approx(0.013)


@pytest.mark.parametrize("offset", [2, 4, 8])
def test_a_wall_that_stands_twice_is_double_and_one_beside_it_is_thick(offset):
    # The west wall is column 19; a copy inside the room along its whole length.
    doubled = with_wall(TRUTH, slice(20, 100), 19 + offset)
    west = np.zeros_like(EVERYWHERE)
    west[30:90, 19] = True
    profile = wall_profile(doubled, TRUTH, IDENTITY, west)
    assert profile.double_wall_rate == 1.0
    assert profile.wall_thickness_m == pytest.approx(0.05)
    thick = wall_profile(with_wall(TRUTH, slice(20, 100), 20), TRUTH, IDENTITY, west)
    assert thick.double_wall_rate == 0.0
    assert thick.wall_thickness_m == pytest.approx(0.10)


def test_specks_behind_a_wall_and_holes_in_it_are_not_a_second_wall():
    rng = np.random.default_rng(3)
    specked = TRUTH.probability.copy()
    behind = specked[:, 9:19]
    behind[rng.random(behind.shape) < 0.3] = 1.0  # in ground that was never seen
    specked[20:100:3, 18], specked[20:100, 17] = np.nan, 1.0  # a thick wall with holes
    west = np.zeros_like(EVERYWHERE)
    west[30:90, 19] = True
    assert wall_profile(like_truth(specked), TRUTH, IDENTITY, west).double_wall_rate == 0.0


def test_a_quarter_of_the_walls_doubled_is_a_rate_of_their_share():
    doubled = with_wall(TRUTH, slice(20, 100), 24)
    profile = wall_profile(doubled, TRUTH, IDENTITY, EVERYWHERE)
    assert profile.double_wall_rate == pytest.approx(80.0 / 400.0, abs=0.05)


def test_a_true_wall_of_two_faces_is_not_double():
    truth = with_wall(room(), slice(20, 100), slice(70, 74), np.nan)
    truth = with_wall(with_wall(truth, slice(20, 100), 69), slice(20, 100), 74)
    assert wall_profile(truth, truth, IDENTITY, truth.known).double_wall_rate == 0.0
    ghost = with_wall(truth, slice(20, 100), 64)
    faces = np.zeros_like(truth.known)
    faces[30:90, [69, 74]] = True
    # From the far face the ghost is 0.5 m away: on the edge of the cut.
    assert wall_profile(ghost, truth, IDENTITY, faces).double_wall_rate == pytest.approx(1.0)


def test_a_missing_wall_lowers_recall_and_only_the_way_from_the_truth():
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


def test_an_invented_wall_lowers_precision_and_only_the_way_to_the_truth():
    invented = with_wall(TRUTH, slice(20, 100), 80)
    overlap = occupied_overlap(invented, TRUTH, EVERYWHERE)
    walls = int(TRUTH.occupied.sum())
    assert overlap.recall == 1.0
    assert overlap.precision == pytest.approx(walls / (walls + 80))
    assert overlap.iou == pytest.approx(walls / (walls + 80))
    there, back = wall_distances(invented, TRUTH, IDENTITY, EVERYWHERE)
    assert back.mean == 0.0
    assert there.mean == pytest.approx(2 * sum(range(1, 41)) * 0.05 / (walls + 80))


def test_walls_off_the_true_map_are_wrong_and_unobservable_ones_are_asked_of_nobody():
    assert occupied_overlap(TRUTH, TRUTH, EVERYWHERE, outside=404).precision == pytest.approx(0.5)
    seen = EVERYWHERE.copy()
    seen[:, 19] = False
    without = with_wall(TRUTH, slice(None), 19, np.nan)
    for grid in (TRUTH, without):
        assert occupied_overlap(grid, TRUTH, seen).iou == 1.0


def test_unobservable_walls_that_were_mapped_all_the_same_earn_nothing():
    seen = EVERYWHERE.copy()
    seen[:, 19] = False
    invented = with_wall(TRUTH, slice(20, 100), 80)
    walls = int((TRUTH.occupied & seen).sum())
    assert occupied_overlap(invented, TRUTH, seen).precision == pytest.approx(walls / (walls + 80))


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


SURE = -np.log(1.0 - CLIP)
WALLS, CELLS = int(TRUTH.occupied.sum()), int(EVERYWHERE.sum())


def test_each_fault_costs_what_its_cells_cost_by_every_score_of_probabilities():
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


def test_a_missing_wall_lowers_coverage_by_its_cells_and_free_cells_know_nothing_of_it():
    missing = with_wall(TRUTH, slice(20, 100), 19, np.nan)
    assert coverage(missing, EVERYWHERE) == pytest.approx(1.0 - 80 / CELLS)
    assert free_overlap(missing, TRUTH, EVERYWHERE).f1 == 1.0
    invented = with_wall(TRUTH, slice(20, 100), 80)
    assert coverage(invented, EVERYWHERE) == 1.0
    free = CELLS - WALLS
    assert free_overlap(invented, TRUTH, EVERYWHERE).iou == pytest.approx((free - 80) / free)


def test_without_truth_a_second_wall_shows_as_more_of_everything():
    plain, doubled = map_structure(TRUTH), map_structure(with_wall(TRUTH, slice(20, 100), 33))
    assert doubled.occupied_share > plain.occupied_share
    assert doubled.corners == plain.corners + 2
    assert doubled.enclosed_areas == plain.enclosed_areas + 1  # 0.65 m x 4 m between the walls


# --- the whole map: turned, finer, coarser, far away


@pytest.mark.parametrize("degrees", [2.0, -5.0])
def test_a_wall_turned_about_its_middle_is_off_by_a_quarter_of_its_length_times_the_sine(degrees):
    truth = with_wall(like_truth(np.zeros((80, 80))), 40, slice(10, 70))  # 3 m long
    x, y = cell_centres(truth, truth.occupied).mean(axis=0)
    T = compose(compose([x, y, np.radians(degrees)], [0.0, 0.0, 0.0]), [-x, -y, 0.0])
    turned = moved(truth, tuple(T))
    expected = 0.25 * 3.0 * np.sin(np.radians(abs(degrees)))
    there, back = wall_distances(turned, truth, IDENTITY, truth.known)
    # To the nearest of cell centres 5 cm apart, not to a line: up to half a cell to the side.
    assert there.mean == pytest.approx(expected, rel=0.12)
    assert back.mean == pytest.approx(expected, rel=0.12)
    assert there.p95 == pytest.approx(0.95 * 1.5 * np.sin(np.radians(abs(degrees))), rel=0.1)
    whole, _ = wall_distances(turned, truth, inverse(T), truth.known)
    assert whole.mean < 1e-9


@pytest.mark.parametrize("turn", [0.3, 0.785, 1.2])
def test_profiles_do_not_depend_on_how_either_map_is_turned(turn):
    doubled = with_wall(TRUTH, slice(20, 100), 24)
    straight = wall_profile(doubled, TRUTH, IDENTITY, EVERYWHERE)
    # Both turned alike: the same cuts. Only the map's cells turned: the same walls on other cells.
    T = (1.0, -2.0, turn)
    alike = wall_profile(moved(doubled, T), moved(TRUTH, T), IDENTITY, EVERYWHERE)
    assert alike.double_wall_rate == pytest.approx(straight.double_wall_rate, abs=1e-3)
    assert alike.wall_thickness_m == pytest.approx(straight.wall_thickness_m, abs=1e-3)
    perfect = wall_profile(on_turned_cells(TRUTH, turn), TRUTH, IDENTITY, EVERYWHERE)
    assert perfect.double_wall_rate < 0.01
    assert perfect.wall_thickness_m == pytest.approx(0.05, abs=0.015)


def on_turned_cells(grid: OccupancyGrid, turn: float) -> OccupancyGrid:
    """The same place, drawn on cells that are turned about its middle; no wall is lost between the cells."""
    canvas = OccupancyGrid(
        probability=np.zeros((240, 240), np.float32),
        resolution=grid.resolution,
        origin=tuple(compose([3.0, 2.0, turn], [-6.0, -6.0, 0.0]).tolist()),
    )
    return resample(grid, canvas, IDENTITY)


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


def test_lookup_finds_each_cell_by_its_centre_in_any_frame():
    rng = np.random.default_rng(1)
    grid = OccupancyGrid(probability=rng.random((7, 9), dtype=np.float32), resolution=0.1, origin=(3.0, -2.0, 0.7))
    centres = cell_centres(grid, grid.known)
    np.testing.assert_array_equal(lookup(grid, centres), grid.probability.ravel())
    assert np.isnan(lookup(grid, centres + 100.0)).all()


def test_the_true_map_of_a_world_becomes_1_0_and_unknown():
    occupied, free = np.array([[True, False, False]]), np.array([[False, True, False]])
    grid = grid_from_true_map(TrueMap(occupied=occupied, free=free, resolution=0.1, origin=(0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(grid.probability, [[1.0, 0.0, np.nan]])


# --- probabilities


def test_a_map_that_knows_nothing_scores_ln_2_and_a_quarter():
    score = probability_score(like_truth(np.full(TRUTH.probability.shape, np.nan)), TRUTH, EVERYWHERE)
    assert score.log_loss == pytest.approx(np.log(2.0))
    assert score.brier == 0.25
    assert score.auc == 0.5


def test_a_map_that_means_what_it_says_is_calibrated_and_one_too_sure_is_not():
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


# --- without truth


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


def test_maps_without_a_known_cell_or_wall_have_no_score_rather_than_a_good_one():
    unknown = like_truth(np.full(TRUTH.probability.shape, np.nan))
    assert map_structure(unknown) is None
    assert wall_distances(unknown, TRUTH, IDENTITY, EVERYWHERE) is None
    assert occupied_overlap(unknown, TRUTH, EVERYWHERE).iou == 0.0
    assert coverage(unknown, EVERYWHERE) == 0.0
    profile = wall_profile(unknown, TRUTH, IDENTITY, EVERYWHERE)
    assert (profile.missing_wall_rate, profile.double_wall_rate, profile.wall_thickness_m) == (1.0, None, None)
    assert probability_score(TRUTH, unknown, unknown.known) is None
