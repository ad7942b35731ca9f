# SPDX-License-Identifier: MIT
"""Ray traversal against exact rational geometry."""

import itertools

import numpy as np
from hypothesis import assume, given, settings

from slam.grid._tile_kernels import SHIFT, SIDE
from slam.grid._traversal_kernels import count_misses, tiles_on_rays
from tests.slam.reference import cells_on_segment, crossings
from tests.slam.rooms import dense
from tests.slam.strategies import segments

TILES = 96 // SIDE
SIZE = TILES * SIDE


def misses(segments):
    """Visits (rows, columns) that `count_misses` counts on an empty map, every tile of which may be written."""
    table = np.arange(TILES * TILES, dtype=np.int32).reshape(TILES, TILES)
    counts = np.zeros((TILES * TILES, SIDE * SIDE), np.uint16)
    count_misses(table, counts, np.atleast_2d(segments), np.empty(0, np.int64))
    return dense(table, counts)


def crossed(visits):
    """Cells (x, y) that were counted."""
    return {(int(x), int(y)) for y, x in np.argwhere(visits)}


def demanded(segments):
    """Tiles (x, y) that are demanded for the segments."""
    tiles, seen = np.empty(TILES * TILES + 1, np.int32), np.zeros(TILES * TILES, np.uint8)
    count = tiles_on_rays(np.atleast_2d(segments), TILES, tiles, 0, seen)
    assert sorted(tiles[:count]) == np.flatnonzero(seen).tolist()
    return {(place % TILES, place // TILES) for place in tiles[:count].tolist()}


def last_cell(segment):
    return int(segment[2]), int(segment[3])


def passes_a_corner(segment):
    """Whether the segment crosses lines of both kinds so close to each other that rounding decides."""
    return any(abs(a - b) < 1e-9 for a, b in itertools.product(*crossings(segment)))


@given(segments(SIZE))
@settings(deadline=None, max_examples=200)
def test_every_cell_that_the_segment_crosses_is_counted_and_none_else(segment):
    assume(not np.any(segment == np.floor(segment)))  # on the border of two cells
    assume(not passes_a_corner(segment))
    visits = misses(segment)
    assert crossed(visits) | {last_cell(segment)} == set(cells_on_segment(segment))
    assert visits.max() <= 1  # each once
    assert visits[last_cell(segment)[::-1]] == 0  # it belongs to `count_hits`


@given(segments(SIZE))
@settings(deadline=None, max_examples=200)
def test_any_segment_leads_from_its_first_to_its_last_cell_over_sides(segment):
    cells = crossed(misses(segment)) | {last_cell(segment)}
    first, last = (int(segment[0]), int(segment[1])), last_cell(segment)
    assert len(cells) == abs(last[0] - first[0]) + abs(last[1] - first[1]) + 1
    assert first in cells
    for x, y in cells:  # monotone, so that neighbours in order of distance share a side
        assert min(first[0], last[0]) <= x <= max(first[0], last[0])
        assert min(first[1], last[1]) <= y <= max(first[1], last[1])
    order = sorted(cells, key=lambda cell: abs(cell[0] - first[0]) + abs(cell[1] - first[1]))
    for (xa, ya), (xb, yb) in itertools.pairwise(order):
        assert abs(xa - xb) + abs(ya - yb) == 1


@given(segments(SIZE))
@settings(deadline=None, max_examples=300)
def test_exactly_the_tiles_that_are_written_are_demanded(segment):
    """One missing would be a write into a tile that others share; one too many a copy for nothing."""
    cells = crossed(misses(segment)) | {last_cell(segment)}
    assert demanded(segment) == {(x >> SHIFT, y >> SHIFT) for x, y in cells}


def test_axis_parallel_and_diagonal_beams():
    assert crossed(misses([5.5, 7.5, 2.5, 7.5])) == {(5, 7), (4, 7), (3, 7)}
    assert crossed(misses([5.5, 7.5, 5.5, 9.5])) == {(5, 7), (5, 8)}
    assert crossed(misses([5.5, 7.5, 5.6, 7.9])) == set()
    assert crossed(misses([1.25, 1.5, 3.25, 3.5])) == {(1, 1), (1, 2), (2, 2), (2, 3)}


def test_beams_add_up():
    fan = [[48.5, 48.5, 48.5 + 40 * np.cos(a), 48.5 + 40 * np.sin(a)] for a in np.linspace(0.1, 6.2, 50)]
    together = misses(fan)
    np.testing.assert_array_equal(together, sum(misses(beam) for beam in fan))
    assert together[48, 48] == 50
    assert demanded(fan) == set.union(*(demanded(beam) for beam in fan))
