# SPDX-License-Identifier: MIT
"""Shapes that views draw: known answers and laws."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.particles.ancestry import Ancestry
from slam.scan import Scan
from testbed.views.rerun import drawing


def test_cells_are_percent_from_the_top_row_down() -> None:
    grid = OccupancyGrid(
        probability=np.array([[0.0, 1.0], [0.5, np.nan], [0.254, 0.256]], np.float32),
        resolution=0.1,
        origin=(0.0, 0.0, 0.0),
    )
    assert drawing.cells_from_top(grid).tolist() == [[25, 26], [50, 255], [0, 100]]


def test_extent_is_that_of_the_known_cells_in_the_world() -> None:
    probability = np.full((10, 20), np.nan, np.float32)
    probability[2:5, 3:9] = 0.5
    grid = OccupancyGrid(probability=probability, resolution=0.5, origin=(1.0, 2.0, 0.0))
    extent = drawing.extent_of(grid, (10.0, 0.0, np.pi / 2.0))
    # map frame: x in [2.5, 5.5], y in [3, 4.5]; turned to the left: x' = 10 - y, y' = x
    assert (extent.x_min, extent.x_max) == pytest.approx((5.5, 7.0))
    assert (extent.y_min, extent.y_max) == pytest.approx((2.5, 5.5))
    assert extent.centre == pytest.approx((6.25, 4.0))


@given(st.integers(1, 400), st.integers(1, 400))
def test_scan_points_are_bounded_and_leave_misses_out(beams: int, most: int) -> None:
    ranges = np.where(np.arange(beams) % 3 == 0, np.inf, 2.0)
    scan = Scan(ranges=ranges, angles=np.linspace(-np.pi, np.pi, beams), range_max=10.0, mount=(1.0, 0.0, 0.0))
    points = drawing.scan_points(scan, most)
    hits = int(scan.hit.sum())
    assert min(hits, (most + 1) // 2) <= len(points) <= most  # never fewer than half of what may be drawn
    assert np.allclose(np.hypot(points[:, 0] - 1.0, points[:, 1]), 2.0, atol=1e-6)


@given(st.floats(0.01, 3.0), st.floats(0.01, 3.0), st.floats(-1.5, 1.5))
def test_ellipse_has_the_axes_of_the_covariance(a: float, b: float, turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    (long, short), angle = drawing.ellipse(rotation @ np.diag([a * a, b * b]) @ rotation.T)
    assert (long, short) == pytest.approx((2.4477 * max(a, b), 2.4477 * min(a, b)), rel=1e-6)
    if abs(a - b) > 0.01:
        expected = turn if a > b else turn + np.pi / 2.0
        assert np.sin(angle - expected) == pytest.approx(0.0, abs=1e-6)


def test_ellipse_holds_95_percent_of_a_normal_distribution() -> None:
    covariance = np.array([[0.5, 0.3], [0.3, 0.4]])
    points = np.random.default_rng(0).multivariate_normal([0.0, 0.0], covariance, 100_000)
    (long, short), angle = drawing.ellipse(covariance)
    axes = se2.transform_points(se2.inverse([0.0, 0.0, angle]), points) / (long, short)
    assert np.mean(np.sum(axes**2, axis=1) <= 1.0) == pytest.approx(0.95, abs=0.003)


@settings(deadline=None)  # the first call compiles kernels
@given(st.integers(1, 12), st.integers(1, 15), st.integers(0, 2**32 - 1))
def test_branches_draw_each_limb_of_the_tree_exactly_once(particles: int, generations: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = Ancestry(particles)
    for _ in range(generations):
        tree.add(rng.normal(size=(particles, 3)))
        if rng.uniform() < 0.5:
            tree.inherit(np.sort(rng.integers(particles, size=particles)))
    paths = [tree.path(i) for i in range(particles)]

    def limbs(strips: list[np.ndarray]) -> list[tuple[float, ...]]:
        return [(*map(float, a), *map(float, b)) for strip in strips for a, b in itertools.pairwise(strip)]

    drawn = limbs(drawing.branches(paths))
    assert len(drawn) == len(set(drawn))
    assert set(drawn) == set(limbs([path[:, :2] for path in paths]))


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=40))
def test_four_particles_from_the_heaviest_to_the_lightest(values: list[float]) -> None:
    weights = np.array(values)
    chosen = drawing.spread_over_weights(weights, 4)
    assert weights[chosen[0]] == weights.max()
    assert weights[chosen[-1]] == weights.min()
    assert np.all(np.diff(weights[chosen]) <= 0.0)


def test_the_heaviest_particle_is_red_and_one_without_weight_light_blue() -> None:
    assert drawing.weight_colours(np.array([0.0, 0.2])).tolist() == [list(drawing.LIGHT), list(drawing.HEAVY)]
