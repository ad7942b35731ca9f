# SPDX-License-Identifier: MIT
"""Outlines of elements: exact areas and lengths, and laws of their union."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from worlds import Block, Box, Disc, Opening, Wall, World

SQUARE = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]


def lengths(segments):
    return np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])


def test_a_closed_thick_wall_has_mitred_corners():
    frame = Wall(points=SQUARE, closed=True, thickness=0.2).shape()
    assert frame.area == pytest.approx(4.2 * 3.2 - 3.8 * 2.8, abs=1e-12)


def test_openings_cut_their_width_out_of_the_wall():
    wall = Wall(points=[(0, 0), (10, 0)], openings=[Opening(at=2.0, width=1.0), Opening(at=9.9, width=1.0)])
    assert wall.shape().length == pytest.approx(10.0 - 1.0 - 0.6, abs=1e-12)
    assert wall.shape().distance(shapely.Point(2.0, 0.0)) == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize(("closed", "length"), [(False, 2.0), (True, 4.0)])
def test_openings_beyond_the_end_of_the_wall_are_refused(closed, length):
    points = [(0, 0), (2, 0)]
    assert Wall(points=points, closed=closed, openings=[Opening(at=length)]).openings
    with pytest.raises(ValueError, match=f"expected openings within the {length:.2f} m of the wall, got one at"):
        Wall(points=points, closed=closed, openings=[Opening(at=length + 0.01)])


def test_opening_in_a_closed_wall_may_lie_on_the_closing_side():
    wall = Wall(points=SQUARE, closed=True, thickness=0.1, openings=[Opening(at=12.5, width=1.0)])
    assert not wall.shape().intersects(shapely.Point(0.0, 1.5))  # 4 + 3 + 4 = 11 m lead to (0, 3)


@given(st.floats(-6.28, 6.28), st.floats(0.1, 5.0), st.floats(0.1, 5.0))
@settings(deadline=None)
def test_rotated_box_keeps_area_and_centre(rotation, width, depth):
    shape = Box(x=1.0, y=-2.0, width=width, depth=depth, rotation=rotation).shape()
    assert shape.area == pytest.approx(width * depth)
    assert (shape.centroid.x, shape.centroid.y) == pytest.approx((1.0, -2.0))


def test_positive_rotation_is_counter_clockwise():
    shape = Box(x=0, y=0, width=2.0, depth=0.2, rotation=math.pi / 6).shape()
    assert shape.contains(shapely.Point(0.9 * math.cos(math.pi / 6), 0.9 * math.sin(math.pi / 6)))


def test_disc_outline_lies_within_half_a_percent_of_its_radius():
    away = np.hypot(*shapely.segmentize(Disc(x=0, y=0, radius=2.0).shape(), 0.01).exterior.xy)
    assert away.max() <= 2.0 + 1e-12
    assert away.min() >= 2.0 * 0.995


def test_union_leaves_out_surfaces_inside_of_solids():
    world = World(
        name="w",
        boxes=[Box(x=0, y=0, width=2, depth=2), Box(x=1, y=0, width=2, depth=2)],
        walls=[Wall(points=[(0, 0), (5, 0)])],
    )
    segments = world.boundary_segments()
    assert lengths(segments).sum() == pytest.approx(2 * (3 + 2) + 3)  # 3 m x 2 m, and 3 m of wall outside
    assert len(segments) == 6  # collinear pieces are joined, but the right side is split at the foot of the wall


def test_lidar_sees_over_low_elements_and_through_glass():
    world = World(
        name="w",
        boxes=[Box(x=0, y=0, width=1, depth=1, height=0.5)],
        walls=[Wall(points=[(3, 0), (3, 1)], glass=True)],
    )
    assert lengths(world.boundary_segments(0.2)).sum() == pytest.approx(5.0)
    assert lengths(world.boundary_segments(0.5)).sum() == pytest.approx(1.0)
    assert lengths(world.boundary_segments(0.2, glass=False)).sum() == pytest.approx(4.0)
    assert world.boundary_segments(0.6, glass=False).shape == (0, 4)


@given(st.lists(st.tuples(*[st.floats(-5, 5)] * 2, *[st.floats(0.2, 3)] * 2, st.floats(-3, 3)), min_size=1, max_size=6))
@settings(deadline=None)
def test_boundary_bounds_exactly_the_union(boxes):
    world = World(name="w", boxes=[Box(x=x, y=y, width=w, depth=d, rotation=r) for x, y, w, d, r in boxes])
    union = shapely.union_all([box.shape() for box in world.boxes])
    assert lengths(world.boundary_segments()).sum() == pytest.approx(union.length, abs=1e-6)
    middles = 0.5 * (world.boundary_segments()[:, :2] + world.boundary_segments()[:, 2:])
    assert max(union.boundary.distance(shapely.Point(m)) for m in middles) < 1e-6


def test_holes_of_blocks_are_boundary_too():
    hole = [(1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)]
    world = World(name="w", polygons=[Block(points=SQUARE, holes=[hole])])
    assert lengths(world.boundary_segments()).sum() == pytest.approx(14 + 4)


def test_path_runs_through_all_laps():
    world = World.model_validate(
        {"name": "w", "start": {"x": 1, "y": 1}, "tour": {"points": [[2, 1], [2, 2]], "closed": True, "laps": 2}}
    )
    expected = [(1, 1), (2, 1), (2, 2), (2, 1), (2, 2), (2, 1)]
    assert world.path().tolist() == [list(map(float, corner)) for corner in expected]


def test_worlds_with_other_elements_have_other_unions():
    walls = [Wall(points=SQUARE, closed=True, thickness=0.2)]
    bare = World(name="bare", walls=walls)
    boxes = [bare.model_copy(update={"boxes": [Box(x=x, y=1.0, width=0.5, depth=0.5)]}) for x in (1.0, 2.0, 3.0)]
    for _ in range(2):
        areas = [world.cross_section().area for world in (bare, *boxes)]
        np.testing.assert_allclose(areas, areas[0] + np.array([0.0, 0.25, 0.25, 0.25]))
        assert len({world.cross_section().wkt for world in (bare, *boxes)}) == 4
        assert bare.cross_section(100.0).is_empty
