# SPDX-License-Identifier: MIT
"""What the cells count, the sub-cell means of end points, and the directions of walls."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.grid._cell_kernels import (
    HIT_SHIFT,
    HITS,
    MEAN_MEMORY,
    VISITS,
    counted,
    mean_x,
    mean_y,
    with_end_point,
)
from slam.grid._wall_kernels import has_enough_hits, is_wall
from slam.matching._likelihood_kernels import NORMALS
from tests.slam.rooms import counts_of, empty_maps, rays, word_at

QUANTUM = 1.0 / 4096.0


def unpacked(word):
    return int(word >> HIT_SHIFT) & int(HITS), int(word & VISITS)


@given(st.integers(0, int(HITS)), st.integers(0, int(VISITS)), st.integers(0, 1))
@settings(deadline=None)
def test_one_more_beam(hits, visits, hit):
    hits = min(hits, visits)
    word = counted(np.uint32(hits << int(HIT_SHIFT) | visits), hit)
    halved = 2 if hits == HITS or visits == VISITS else 1
    assert unpacked(word) == (hits // halved + hit, visits // halved + 1)
    assert 0 <= word <= 0xFFFF


@pytest.mark.parametrize("period", [1, 2, 7])
def test_counts_are_halved_before_they_overflow_and_keep_their_ratio(period):
    word = np.uint32(0)
    for k in range(150_000):
        word = counted(word, 1 if k % period == 0 else 0)
    hits, visits = unpacked(word)
    assert visits >= HITS // 2
    assert hits / visits == pytest.approx(1.0 / period, abs=0.03)  # one part in half the largest count of hits


def test_a_cell_has_enough_hits_from_the_occupied_share_on():
    assert has_enough_hits(np.uint32(1 << int(HIT_SHIFT) | 4), 0.25)
    assert not has_enough_hits(np.uint32(1 << int(HIT_SHIFT) | 5), 0.25)
    assert not has_enough_hits(np.uint32(500), 0.25)
    assert not has_enough_hits(np.uint32(0), 0.25)


FRACTIONS = st.floats(0.0, 1.0, exclude_max=True)


@given(st.lists(st.tuples(FRACTIONS, FRACTIONS), min_size=1, max_size=MEAN_MEMORY), st.integers(0, 255))
@settings(deadline=None)
def test_the_mean_of_end_points_is_their_arithmetic_mean(points, direction):
    surface = np.uint32(direction)
    for n, (x, y) in enumerate(points, start=1):
        surface = with_end_point(surface, np.uint32(n), x, y)
    # each rounding by half a quantum is carried on with its share in the mean
    tolerance = QUANTUM * (0.25 * len(points) + 1.0)
    np.testing.assert_allclose((mean_x(surface), mean_y(surface)), np.mean(points, axis=0), atol=tolerance)
    assert surface & np.uint32(0xFF) == direction


def test_old_end_points_are_forgotten_slowly():
    surface = np.uint32(0)
    for n in range(1, 1001):
        surface = with_end_point(surface, np.uint32(n), 0.1, 0.9)
    for n in range(1001, 1001 + MEAN_MEMORY):
        surface = with_end_point(surface, np.uint32(n), 0.6, 0.4)
    left = (1.0 - 1.0 / MEAN_MEMORY) ** MEAN_MEMORY
    assert mean_x(surface) == pytest.approx(0.6 - 0.5 * left, abs=0.01)
    assert mean_y(surface) == pytest.approx(0.4 + 0.5 * left, abs=0.01)


def test_a_scan_counts_passes_hits_and_clearing_beams():
    maps = empty_maps(cell=0.1)
    maps.integrate_scan(
        np.array([[0.05, 0.05, 0.0]]), rays([(0.5, 0.0), (0.5, 0.0), (0.3, 0.0)], hit=[True, True, False])
    )
    hits, visits, walls = counts_of(maps)
    row, column = -maps.grids.corner[1], -maps.grids.corner[0]
    assert visits[row, column : column + 7].tolist() == [3, 3, 3, 3, 2, 2, 0]
    assert hits[row, column : column + 7].tolist() == [0, 0, 0, 0, 0, 2, 0]
    assert np.argwhere(walls).tolist() == [[row, column + 5]]
    assert visits.sum() == 16


def test_beams_start_at_their_lidar_wherever_the_robot_is():
    maps = empty_maps(cell=0.1)
    beam = rays([(1.0, 0.5)], origin=(0.0, 0.5))
    maps.integrate_scan(np.array([[2.05, -1.05, math.pi / 2.0]]), beam)  # from (1.55, -1.05) to (1.55, -0.05)
    visits = counts_of(maps)[1]
    rows, columns = np.nonzero(visits)
    assert set(columns + maps.grids.corner[0]) == {15}
    assert (rows + maps.grids.corner[1]).tolist() == list(range(-11, 0))


@pytest.mark.parametrize("angle", np.linspace(0.0, math.pi, 13, endpoint=False))
def test_direction_of_a_straight_wall(angle):
    """The normal of a wall in every direction, to half a direction code and the rounding of the means."""
    along, normal = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    points = 2.0 * normal + np.linspace(-1.0, 1.0, 400)[:, None] * along
    maps = empty_maps()
    for _ in range(2):  # directions are fitted to the walls that there are
        maps.integrate_scan(np.zeros((1, 3)), rays(points))
    grids = maps.grids
    cells = np.floor(points[50:-50] / maps.config.cell).astype(int) - grids.corner
    codes = [int(word_at(maps, "surface", point)) & 0xFF for point in points[50:-50]]
    walls = [
        code for code, (x, y) in zip(codes, cells, strict=True) if is_wall(grids.table[0], grids.counts, x, y, 0.25)
    ]
    assert len(walls) > 100
    for code in walls:
        assert code > 0
        assert abs(NORMALS[code] @ along) < math.sin(0.5 * math.pi / 255.0) + 0.004


def test_a_corner_and_a_lone_cell_form_no_line():
    maps = empty_maps(cell=0.1)
    corner = [(1.05, 1.05), (0.95, 1.05), (0.85, 1.05), (1.05, 0.95), (1.05, 0.85)]
    for _ in range(2):
        maps.integrate_scan(np.zeros((1, 3)), rays([*corner, (-1.05, 0.35)]))
    for point in (corner[0], (-1.05, 0.35)):
        assert int(word_at(maps, "surface", point)) & 0xFF == 0


def test_normals_are_unit_vectors_of_their_code():
    np.testing.assert_array_equal(NORMALS[0], 0.0)
    np.testing.assert_allclose(np.hypot(*NORMALS[1:].T), 1.0)
    assert np.all(np.diff(np.arctan2(NORMALS[1:, 1], NORMALS[1:, 0])) > 0.0)
