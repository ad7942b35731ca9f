# SPDX-License-Identifier: MIT
"""The true map: cells against exact geometry."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import worlds
from worlds import Box, Start, Wall, World
from worlds.raster import _connected, _dilated, cells_crossed

ROOM = World(
    name="room",
    start=Start(x=1.0, y=1.0),
    walls=[Wall(points=[(0, 0), (4, 0), (4, 3), (0, 3)], closed=True, thickness=0.2)],
    boxes=[Box(x=2.0, y=1.5, width=0.5, depth=0.5)],
)


def cell(truth, x, y):
    """Row and column of the cell at (x, y)."""
    return tuple(
        int(np.floor((value - low) / truth.resolution)) for value, low in ((y, truth.origin[1]), (x, truth.origin[0]))
    )


def test_faces_on_cell_edges_mark_the_cell_inside_the_solid():
    truth = worlds.true_map(ROOM, 0.05)
    assert truth.occupied[cell(truth, 0.075, 1.0)]  # the wall's face is x = 0.1
    assert truth.free[cell(truth, 0.125, 1.0)]
    assert truth.occupied[cell(truth, 3.925, 1.0)]
    assert truth.free[cell(truth, 3.875, 1.0)]
    assert truth.occupied[cell(truth, 1.775, 1.5)]  # the box's left face is x = 1.75
    assert truth.free[cell(truth, 1.725, 1.5)]


def test_inside_of_solids_and_outside_of_the_room_are_neither():
    truth = worlds.true_map(ROOM, 0.05)
    for x, y in ((2.0, 1.5), (0.0, 1.0), (-0.075, 1.0), (-0.3, 1.0), (4.3, 3.3)):
        at = cell(truth, x, y)
        assert not truth.occupied[at]
        assert not truth.free[at]


def test_areas_are_those_of_the_geometry():
    truth = worlds.true_map(ROOM, 0.05)
    assert truth.free.sum() * 0.05**2 == pytest.approx(3.8 * 2.8 - 0.25)
    rim = 2 * (76 + 56) + 4 + (4 * 10 - 4)  # cells about the free area with its corners, and the rim of the box
    assert truth.occupied.sum() == rim


@pytest.mark.parametrize("resolution", [0.03, 0.05, 0.1])
def test_occupied_cells_are_those_with_a_visible_surface(resolution):
    world = worlds.load("office")
    truth = worlds.true_map(world, resolution, height=0.2)
    surface = shapely.union_all(shapely.linestrings(world.boundary_segments(0.2).reshape(-1, 2, 2)))
    rows, cols = np.nonzero(truth.occupied)
    x, y = (cols + 0.5) * resolution + truth.origin[0], (rows + 0.5) * resolution + truth.origin[1]
    assert shapely.distance(shapely.points(x, y), surface).max() <= resolution * 0.5**0.5 + 2e-6
    assert not np.any(truth.occupied & truth.free)


def test_cells_lie_on_whole_multiples_of_the_resolution():
    for resolution in (0.03, 0.05, 0.07):
        truth = worlds.true_map(ROOM, resolution)
        assert np.allclose(np.array(truth.origin[:2]) / resolution % 1.0 % 1.0, 0.0, atol=1e-9) or np.allclose(
            np.array(truth.origin[:2]) / resolution, np.round(np.array(truth.origin[:2]) / resolution)
        )


def test_low_things_are_not_on_the_map_of_a_high_lidar():
    low = ROOM.model_copy(update={"boxes": [Box(x=2.0, y=1.5, width=0.5, depth=0.5, height=0.3)]})
    assert worlds.true_map(low, 0.05, height=0.2).occupied.sum() > worlds.true_map(low, 0.05, height=0.4).occupied.sum()


def test_huge_maps_are_refused():
    far = ROOM.model_copy(update={"boxes": [Box(x=900.0, y=900.0, width=1.0, depth=1.0)]})
    with pytest.raises(worlds.WorldError, match="above the limit"):
        worlds.true_map(far, 0.01)
    with pytest.raises(ValueError, match="resolution must be positive"):
        worlds.true_map(ROOM, 0.0)


coordinate = st.floats(-20.0, 20.0)


@given(coordinate, coordinate, coordinate, coordinate)
@settings(max_examples=200, deadline=None)
def test_cells_crossed_are_those_with_a_part_of_the_segment(x0, y0, x1, y1):
    line = shapely.LineString([(x0, y0), (x1, y1)])
    rows, cols = cells_crossed(np.array([[x0, y0, x1, y1]]))
    found = set(zip(rows.tolist(), cols.tolist(), strict=True))
    low_x, low_y = int(np.floor(min(x0, x1))) - 1, int(np.floor(min(y0, y1))) - 1
    for row in range(low_y, int(np.ceil(max(y0, y1))) + 1):
        for col in range(low_x, int(np.ceil(max(x0, x1))) + 1):
            part = shapely.box(col, row, col + 1, row + 1).intersection(line).length
            if part > 1e-6:
                runs_along_the_edge = {(row, col), (row, col - 1), (row - 1, col), (row + 1, col), (row, col + 1)}
                assert found & runs_along_the_edge
            if (row, col) in found:
                assert shapely.box(col, row, col + 1, row + 1).distance(line) < 1e-6


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 30), cols=st.integers(1, 30), share=st.floats(0.3, 0.95))
@settings(deadline=None, max_examples=100)
def test_connected_cells_are_those_of_scipy(seed, rows, cols, share):
    rng = np.random.default_rng(seed)
    cells = rng.random((rows, cols)) < share
    start = (int(rng.integers(rows)), int(rng.integers(cols)))
    labels, _ = ndimage.label(cells)
    expected = (labels == labels[start]) & cells[start]
    np.testing.assert_array_equal(_connected(cells, start), expected)
    np.testing.assert_array_equal(_dilated(cells), ndimage.binary_dilation(cells, np.ones((3, 3))))
    assert not _connected(cells, (-1, 0)).any()
