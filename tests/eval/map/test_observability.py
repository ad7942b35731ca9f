# SPDX-License-Identifier: MIT
"""What a lidar can see of a true map: walls hide, range ends, a field of view and a mount count."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.map import lidar_view
from eval.map.grids import cell_centres
from eval.map.lidar_view import LidarView
from eval.map.observability import observable_cells
from slam.scan import Scan
from slam.se2 import compose, inverse, transform_points
from tests.eval.helpers import moved, room, with_wall

TRUTH = room()
MIDDLE = [3.0, 2.0, 0.0]


def scan(first_deg: float, last_deg: float, beams: int, *, range_max: float = 10.0, mount=(0.0, 0.0, 0.0)) -> Scan:
    return Scan(
        ranges=np.ones(beams),
        angles=np.radians(np.linspace(first_deg, last_deg, beams)),
        range_max=range_max,
        mount=mount,
    )


def test_an_empty_room_is_seen_whole_and_nothing_else():
    seen = observable_cells(TRUTH, [[3.0, 2.0, 0.0]], lidar=LidarView())
    corners = np.zeros_like(seen)
    corners[np.ix_([19, 100], [19, 140])] = True
    np.testing.assert_array_equal(seen | corners, TRUTH.known)


def test_a_wall_hides_what_is_behind_it_and_range_ends_sight():
    divided = with_wall(TRUTH, slice(20, 100), 80)
    seen = observable_cells(divided, [[1.0, 2.0, 0.0]], lidar=LidarView())
    assert not seen[20:100, 81:].any()
    assert seen[20:100, 20:81].all()
    near = observable_cells(TRUTH, [[3.0, 2.0, 0.0]], lidar=LidarView(range_max=1.0))
    distance = np.linalg.norm(cell_centres(TRUTH, near) - [3.0, 2.0], axis=1)
    assert distance.max() <= 1.0 + 0.05 * np.sqrt(2.0)
    assert near.sum() == pytest.approx(np.pi / 0.05**2, rel=0.06)


def test_positions_off_the_map_or_in_a_wall_see_nothing():
    assert not observable_cells(TRUTH, [[100.0, 0.0, 0.0], [-0.025, 2.0, 0.0]], lidar=LidarView()).any()


@pytest.mark.parametrize("heading", [0.0, 0.7, np.pi / 2, -2.5])
def test_a_lidar_that_looks_ahead_sees_half_of_the_room(heading):
    ahead = LidarView(first=-np.pi / 2, width=np.pi)
    seen = observable_cells(TRUTH, [[3.0, 2.0, heading]], lidar=ahead)
    x, _ = transform_points(inverse([3.0, 2.0, heading]), cell_centres(TRUTH, TRUTH.free)).T
    free_seen = seen[TRUTH.free]
    # A ray is a third of a degree wide and a cell 5 cm.
    assert free_seen[x > 0.1].all()
    assert not free_seen[x < -0.1].any()


def test_a_turn_on_the_spot_shows_everything_around():
    ahead = LidarView(first=-np.pi / 4, width=np.pi / 2)
    turning = np.column_stack([np.full(60, 3.0), np.full(60, 2.0), np.linspace(0.0, 2.0 * np.pi, 60)])
    np.testing.assert_array_equal(
        observable_cells(TRUTH, turning, lidar=ahead), observable_cells(TRUTH, [MIDDLE], lidar=LidarView())
    )


def test_a_lidar_on_a_mount_looks_from_there():
    # A wall with a slot at y = 3 m: only a lidar a metre to the left of the robot looks through it.
    divided = with_wall(with_wall(TRUTH, slice(20, 100), 80), slice(79, 81), 80, 0.0)
    beyond = np.zeros_like(TRUTH.free)
    beyond[79:81, 81:140] = True
    straight_on = [1.0, 2.0, 0.0]
    assert not observable_cells(divided, [straight_on], lidar=LidarView())[beyond].all()
    assert observable_cells(divided, [straight_on], lidar=LidarView(mount=(0.0, 1.0, 0.0)))[beyond].all()


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-3.1, 3.1))
@settings(max_examples=10, deadline=None)
def test_what_is_seen_does_not_depend_on_the_frame(x, y, theta):
    lidar = LidarView(first=-1.0, width=2.2, range_max=2.5, mount=(0.2, 0.1, 0.3))
    poses = np.array([[1.0, 2.0, 0.4], [4.0, 1.0, 2.0]])
    T = (x, y, theta)
    here, there = (
        observable_cells(TRUTH, poses, lidar=lidar),
        observable_cells(moved(TRUTH, T), compose(T, poses), lidar=lidar),
    )
    assert np.mean(here != there) < 0.003  # cells on the edge of a ray


# --- the view, from scans


def test_the_field_of_view_is_without_the_widest_gap():
    half = LidarView.of([scan(-90.0, 90.0, 181, range_max=8.0, mount=(0.1, 0.0, 0.0))])
    assert (half.first, half.width) == pytest.approx((-np.pi / 2, np.pi), abs=1e-5)
    assert (half.range_max, half.mount, half.all_around) == (8.0, (0.1, 0.0, 0.0), False)
    assert LidarView.of([scan(-180.0, 179.0, 360)]).all_around
    assert LidarView.of([scan(0.0, 359.0, 360)]).all_around
    assert LidarView.of([scan(-180.0, 171.0, 40)]).all_around  # nine degrees from beam to beam
    backwards = LidarView.of([scan(135.0, 225.0, 91)])
    assert (backwards.first, backwards.width) == pytest.approx((np.radians(135.0), np.pi / 2), abs=1e-5)


@pytest.mark.parametrize("at_once", [1, 2, 1000])
def test_the_widest_of_scans_whose_beams_vary_counts(at_once, monkeypatch):
    monkeypatch.setattr(lidar_view, "_WAITING", at_once)
    narrow = scan(-20.0, 20.0, 41, range_max=7.0)
    scans = [scan(-90.0, 90.0, 181, range_max=8.0), scan(-120.0, 60.0, 170, range_max=9.0), narrow, narrow]
    view = LidarView.of(scans)
    assert (view.first, view.width) == pytest.approx((np.radians(-120.0), np.radians(210.0)), abs=1e-5)
    assert view.range_max == 9.0
    with pytest.raises(ValueError, match="at least one scan"):
        LidarView.of([])


@given(st.floats(-180.0, 180.0), st.floats(10.0, 340.0), st.integers(30, 700))
@settings(max_examples=50)
def test_a_view_made_of_scans_sees_every_beam(first, width, beams):
    angles = np.radians(np.linspace(first, first + width, beams))
    view = LidarView.of([Scan(ranges=np.ones(beams), angles=angles, range_max=5.0)])
    widened = LidarView(first=view.first - 1e-5, width=min(view.width + 2e-5, 2.0 * np.pi))
    assert widened.sees(angles).all()
    if 360.0 - width > max(3.0, 3.0 * width / (beams - 1)) + 0.01:
        assert not view.sees(np.radians(first + width + (360.0 - width) / 2.0))


@pytest.mark.parametrize(
    "view", [LidarView(), LidarView(first=-1.0, width=2.0, range_max=12.0, mount=(0.1, -0.2, 0.3))]
)
def test_a_view_comes_back_from_metrics(view):
    back = LidarView.from_metrics(json.loads(json.dumps(view.metrics)))
    assert (back.first, back.width, back.range_max) == pytest.approx((view.first, view.width, view.range_max))
    assert back.mount == pytest.approx(view.mount)
    assert back.all_around == view.all_around


@pytest.mark.parametrize("bad", [{"width": 0.0}, {"width": 7.0}, {"range_max": 0.0}, {"first": math.nan}])
def test_a_view_of_nothing_is_refused(bad):
    with pytest.raises(ValueError, match="a lidar's view takes"):
        LidarView(**bad)


def test_a_beam_without_a_direction_changes_no_view():
    """Drivers mark beams that do not exist by NaN; the rays leave them out as well."""
    whole = scan(-90.0, 90.0, 181)
    angles = whole.angles.copy()
    angles[[0, 50, 180]] = np.nan, np.inf, np.nan
    seen = LidarView.of([Scan(ranges=whole.ranges, angles=angles, range_max=10.0)])
    assert seen.width == pytest.approx(np.radians(178.0), abs=1e-5)
    assert LidarView.of([whole, Scan(ranges=whole.ranges, angles=angles, range_max=10.0)]) == LidarView.of([whole])
    with pytest.raises(ValueError, match="got none with a direction"):
        LidarView.of([Scan(ranges=np.ones(2), angles=np.full(2, np.nan), range_max=10.0)])
