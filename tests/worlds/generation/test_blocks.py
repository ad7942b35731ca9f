# SPDX-License-Identifier: MIT
"""Corridors around blocks have exactly the loops that were asked for."""

from itertools import pairwise

import numpy as np
import pytest
import shapely

import worlds
from worlds.generation.blocks import CORRIDOR_WIDTH, MAX_SHIFT, lay_out_blocks


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("width", "depth"), [(8.25, 8.25), (14.5, 14.5), (30.0, 24.0), (200.0, 200.0)])
def test_a_ring_has_the_stated_loop(width, depth, seed):
    layout = lay_out_blocks((width, depth), 1, np.random.default_rng(seed))
    loop = shapely.box(layout.x[0], layout.y[0], layout.x[1], layout.y[1]).length
    assert loop == pytest.approx(2.0 * (width + depth) - 4.0 * CORRIDOR_WIDTH)
    (block,) = layout.floor.interiors  # the recesses of its doors lie within it: they change no corner
    expected = shapely.box(CORRIDOR_WIDTH, CORRIDOR_WIDTH, width - CORRIDOR_WIDTH, depth - CORRIDOR_WIDTH)
    assert shapely.Polygon(block).convex_hull.symmetric_difference(expected).area == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("blocks", "cols", "rows"), [(1, 1, 1), (2, 2, 1), (4, 2, 2), (5, 5, 1), (6, 3, 2), (9, 3, 3)])
def test_blocks_stand_in_rows_and_columns(blocks, cols, rows):
    size = (12.0 * cols, 10.0 * rows)
    layout = lay_out_blocks(size, blocks, np.random.default_rng(1))
    assert (len(layout.x), len(layout.y)) == (cols + 1, rows + 1)
    assert len(layout.floor.interiors) == blocks
    for lines, side in ((layout.x, size[0]), (layout.y, size[1])):
        even = np.linspace(0.5 * CORRIDOR_WIDTH, side - 0.5 * CORRIDOR_WIDTH, len(lines))
        assert np.abs(np.subtract(lines, even)).max() <= MAX_SHIFT * (even[1] - even[0]) + 1e-3
        assert lines[0] == even[0]
        assert lines[-1] == even[-1]


@pytest.mark.parametrize("seed", range(4))
def test_a_tour_drives_all_corridors_and_goes_on_over_known_floor(seed):
    world = worlds.generate("blocks", size=(24.0, 22.0), loops=4, clutter=2.0, seed=seed)
    path = shapely.LineString(world.path())
    seen = path.buffer(0.51 * CORRIDOR_WIDTH, cap_style="square")
    corridors = worlds.generate("blocks", size=(24.0, 22.0), loops=4, clutter=0.0, seed=seed).free_space()
    assert corridors.difference(seen).area < 0.05 * corridors.area  # recesses and rounded corners
    first, last = world.path()[0], world.path()[-1]
    assert 0.0 < np.hypot(*(last - first)) <= 12.0 + 1e-9
    legs = [shapely.LineString(leg) for leg in pairwise(world.path())]
    assert any(leg.distance(shapely.Point(last)) < 1e-6 for leg in legs[:-1])


def test_clutter_adds_objects_to_the_same_corridors():
    bare, full = (worlds.generate("blocks", size=(20.0, 20.0), loops=1, clutter=c, seed=3) for c in (0.0, 4.0))
    assert not bare.boxes
    assert not bare.discs
    assert len(full.boxes) + len(full.discs) > 20
    assert full.polygons == bare.polygons


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"loops": 0}, "at least one loop"), ({"size": (10.0, 10.0), "loops": 9}, "fewer loops or a larger size")],
)
def test_blocks_that_do_not_fit_are_refused(arguments, message):
    with pytest.raises(worlds.WorldError, match=message):
        worlds.generate("blocks", **arguments)
