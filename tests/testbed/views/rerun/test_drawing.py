# SPDX-License-Identifier: MIT
"""Shapes that views draw: known answers and laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from testbed.views.rerun import drawing


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
    half, angles = drawing.ellipses((rotation @ np.diag([a * a, b * b]) @ rotation.T)[None])
    (long, short), angle = half[0], angles[0]
    assert (long, short) == pytest.approx((2.4477 * max(a, b), 2.4477 * min(a, b)), rel=1e-6)
    if abs(a - b) > 0.01:
        expected = turn if a > b else turn + np.pi / 2.0
        assert np.sin(angle - expected) == pytest.approx(0.0, abs=1e-6)


def test_ellipse_holds_95_percent_of_a_normal_distribution() -> None:
    covariance = np.array([[0.5, 0.3], [0.3, 0.4]])
    points = np.random.default_rng(0).multivariate_normal([0.0, 0.0], covariance, 100_000)
    half, angles = drawing.ellipses(covariance[None])
    (long, short), angle = half[0], angles[0]
    axes = se2.transform_points(se2.inverse([0.0, 0.0, angle]), points) / (long, short)
    assert np.mean(np.sum(axes**2, axis=1) <= 1.0) == pytest.approx(0.95, abs=0.003)


def test_wall_lines_run_along_rows_and_columns_of_walls() -> None:
    probability = np.zeros((5, 8), np.float32)
    probability[1, 2:6] = probability[1:4, 5] = 1.0
    grid = OccupancyGrid(probability=probability, resolution=0.5, origin=(10.0, 20.0, 0.0))
    lines = sorted(line.tolist() for line in drawing.wall_lines(grid))
    assert lines == [[[11.0, 20.75], [13.0, 20.75]], [[12.75, 20.5], [12.75, 22.0]]]


def test_the_heaviest_particle_is_red_and_one_without_weight_light_blue() -> None:
    assert drawing.weight_colours(np.array([0.0, 1.0])).tolist() == [list(drawing.LIGHT), list(drawing.HEAVY)]
