# SPDX-License-Identifier: MIT
"""The field of nearest walls, kept up to date cell by cell, equals the field built from scratch."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.sensor.rays import Rays, make_rays
from tests.slam.rooms import counts_of, dense, drive, empty_maps, rays, scan_at


def field_from_scratch(walls, radius):
    """Offset to the nearest wall from all cells, (rows, columns, 2), by trying all from the nearest to the farthest;
    0, 0 where there is none or the cell is one."""
    reach = range(-radius, radius + 1)
    inside = [(dx * dx + dy * dy, dy, dx) for dy in reach for dx in reach if dx * dx + dy * dy <= radius * radius]
    rows, columns = walls.shape
    padded = np.pad(walls, radius)
    field, found = np.zeros((*walls.shape, 2), np.int64), np.zeros(walls.shape, bool)
    for _, dy, dx in sorted(inside):  # at a tie the lower wall, then the left one
        there = padded[radius + dy : radius + dy + rows, radius + dx : radius + dx + columns]
        field[there & ~found] = dx, dy
        found |= there
    return field


def assert_fields_are_true(maps, particles, radius):
    for particle in range(particles):
        walls = counts_of(maps, particle)[2]
        words = dense(maps.grids.field_table[particle], maps.grids.nearest)
        np.testing.assert_array_equal(maps.grids.offset[words], field_from_scratch(walls, radius))
        if walls.any():
            np.testing.assert_array_equal(words == words.max(), walls)  # a wall is its own nearest


def random_rays(rng, reach):
    """A scan without any sense: ends anywhere, beams from two lidars, some of them clearing only."""
    n = int(rng.integers(1, 25))
    origins = np.where(rng.random((n, 1)) < 0.5, (0.2, 0.0), (-0.2, 0.1))
    return Rays(origins, rng.uniform(-reach, reach, (n, 2)), rng.random(n) < 0.8)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 3, 5, 8, 11]), st.integers(1, 4))
@settings(deadline=None, max_examples=25)
def test_after_any_scans_and_resampling_the_field_is_that_of_the_walls(seed, radius, particles):
    """Beams of random scans cross walls of earlier ones, which vanish again and come back."""
    rng = np.random.default_rng(seed)
    maps = empty_maps(particles, cell=0.1, field_radius=0.1 * radius)
    reach = rng.choice([0.5, 1.5, 4.0])
    flips = 0
    before = None
    for _ in range(12):
        poses = rng.normal(scale=(0.5, 0.5, 2.0), size=(particles, 3))
        maps.integrate_scan(poses, random_rays(rng, reach))
        if rng.random() < 0.4:
            maps.inherit(np.sort(rng.integers(0, particles, particles)))
        now = [int(counts_of(maps, k)[2].sum()) for k in range(particles)]
        flips += now != before
        before = now
        assert_fields_are_true(maps, particles, radius)
    assert flips > 1


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_fields_of_a_drive_through_a_room(threads):
    maps = empty_maps(5, threads=threads)
    rng = np.random.default_rng(0)
    for truth in drive(8):
        scan = make_rays([scan_at(truth, beams=180)], usable_range=80.0)
        maps.integrate_scan(truth + rng.normal(scale=(0.03, 0.03, 0.02), size=(5, 3)), scan)
        maps.inherit(np.sort(rng.integers(0, 5, 5)))
    assert_fields_are_true(maps, 5, 8)


def test_a_wall_that_is_seen_through_vanishes_and_comes_back():
    maps = empty_maps(cell=0.1, wall_share=0.25, occupied_share=0.5)
    here = np.zeros((1, 3))
    near, far = rays([(1.05, 0.05)]), rays([(2.05, 0.05)])
    seen = []
    for ray in [near] + [far] * 4 + [near]:
        maps.integrate_scan(here, ray)
        row, column = -maps.grids.corner[1], 10 - maps.grids.corner[0]
        seen.append(bool(counts_of(maps)[2][row, column]))
        assert_fields_are_true(maps, 1, 4)
    assert seen == [True, True, True, True, False, True]  # 1 of 4 still is the share of a wall, 1 of 5 is not


def test_more_changes_than_fit_the_list_are_made_up_for_by_later_scans():
    """A beam along a wall of 1200 cells, seen edge on, clears more cells at once than a scan may change."""
    maps = empty_maps(cell=0.1, field_radius=0.3, usable_range=200.0)
    here = np.zeros((1, 3))
    x = 0.05 + 0.1 * np.arange(1200)
    side_on = Rays(
        np.column_stack([x, np.full(1200, 0.35)]), np.column_stack([x, np.full(1200, 0.05)]), np.ones(1200, bool)
    )
    maps.integrate_scan(here, side_on)
    assert counts_of(maps)[2].sum() == 1200
    edge_on = rays([(121.0, 0.05)] * 6)
    left = []
    for _ in range(3):
        maps.integrate_scan(here, edge_on)
        left.append(int(counts_of(maps)[2].sum()))
        assert_fields_are_true(maps, 1, 3)
    assert left[0] > 1  # the case that this test is about
    assert left[-1] == 1  # the end of the beams


def test_growth_in_any_direction_keeps_maps_and_fields():
    maps = empty_maps(2, cell=0.1)
    start = np.zeros((2, 3))
    maps.integrate_scan(start, rays([(0.55, 0.05), (0.05, -0.55)]))
    for heading in (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi, 2.2):
        away = se2.compose((0.0, 0.0, heading), (15.0, 0.0, 0.0))
        maps.integrate_scan(np.array([away, away]), rays([(0.55, 0.05), (0.05, -0.55)]))
        assert_fields_are_true(maps, 2, 4)
    hits, _, walls = counts_of(maps, 1)
    assert hits.sum() == walls.sum() == 12
    low = -maps.grids.corner
    assert walls[low[1], low[0] + 5]
    assert walls[low[1] - 6, low[0]]
