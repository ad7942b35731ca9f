# SPDX-License-Identifier: MIT
"""The map of a finished run: where end points go, and how thick walls become."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import FilterConfig
from slam._threads import Threads
from slam.grid.particle_maps import ParticleMaps
from slam.refinement.noise import INITIAL, Noise
from slam.refinement.redraw_map import DEPTH, max_snap_distance, redraw_map, snap_to_walls
from slam.refinement.surfels import Lines, Surfels, find_surfels, make_cells, make_cloud, transform_cloud
from slam.sensor.rays import make_rays
from tests.slam.rooms import WALLS, drive, rays, scan_at

CONFIG = FilterConfig()
THREADS = Threads(1)


def walls_of(parts, poses, config, noise):
    """Cells and surfels of scans given as `Rays`, taken at poses (scans, 3)."""
    cloud = make_cloud(parts, config.max_points)
    there = transform_cloud(cloud, np.asarray(poses, dtype=np.float64), THREADS)
    cells, cell_of = make_cells(there.points, config.cell)
    reach = max_snap_distance(config, noise)
    return cells, find_surfels(there, cloud, cells, cell_of, config, (noise, noise), reach, THREADS)


def one_wall(point, normal, points):
    """A surfel at `point`, listed for all cells of points (n, 2)."""
    cells, _ = make_cells(points, CONFIG.refine.cell)
    count = len(cells.coordinates)
    lines = Lines(np.zeros((count, 2)), np.zeros((count, 2, 2)), np.zeros((count, 2, 2)))
    listed = np.arange(count + 1), np.zeros(count, np.int32)
    return cells, Surfels(np.array([point]), np.array([normal]), np.ones(1), lines, *listed)


@given(st.floats(1.0, 9.0), st.floats(-1.2, 1.2), st.floats(-1.0, 1.0), st.floats(-0.1, 0.1))
@settings(deadline=None)
def test_an_end_point_moves_to_its_mean_given_the_wall(distance, slant, off, beside):
    """Against conditioning a Gaussian of two dimensions by the textbook."""
    noise, normal = Noise(0.02**2, 0.01**2, 0.004**2, 0.005**2), np.array([-np.cos(slant), -np.sin(slant)])
    floor = noise.floor + noise.shared
    covariance = np.diag([floor + noise.along * distance**2, floor + noise.across * distance**2])
    sigma = np.sqrt(normal @ covariance @ normal)
    end = np.array([[distance, 0.0]])
    point = end[0] + off * 2.0 * sigma * normal + beside * np.array([-normal[1], normal[0]])
    walls = one_wall(point, normal, end)
    (moved,) = snap_to_walls([rays(end)], np.zeros((1, 3)), walls, noise, CONFIG, THREADS)
    gain = covariance @ normal / (normal @ covariance @ normal)
    expected = end[0] - gain * (normal @ (end[0] - point)) - DEPTH * CONFIG.map.cell * normal
    np.testing.assert_allclose(moved.ends[0], expected, atol=1e-9)


def test_end_points_without_a_wall_and_beams_without_a_hit_stay():
    ends = np.array([[2.0, 0.0], [2.0, 0.1], [2.0, 3.0], [0.5, -1.0]])
    walls = one_wall((2.02, 0.0), (-1.0, 0.0), ends)
    scan = rays(ends)._replace(hit=np.array([True, False, True, True]))
    (moved,) = snap_to_walls([scan], np.zeros((1, 3)), walls, INITIAL, CONFIG, THREADS)
    np.testing.assert_array_equal(moved.ends[1], ends[1])
    np.testing.assert_allclose(moved.ends[2:], ends[2:], atol=1e-12)  # 3 m along the wall, 1.5 m before it
    assert moved.ends[0, 0] == pytest.approx(2.02 + DEPTH * CONFIG.map.cell)
    np.testing.assert_array_equal(scan.ends, ends)  # what was given is left alone


def noisy_room(seed, share):
    """Rays of 30 scans in the room, whose ranges err by that share of them, and their poses."""
    rng = np.random.default_rng(seed)
    poses = drive(29, distance=0.08, turn=0.2)
    parts = []
    for pose in poses:
        exact = make_rays([scan_at(pose, beams=360)], usable_range=20.0)
        towards = exact.ends - exact.origins
        ranges = np.linalg.norm(towards, axis=1, keepdims=True)
        error = rng.normal(scale=share * ranges)
        parts.append(exact._replace(ends=exact.ends + towards / ranges * error))
    return parts, poses


@pytest.mark.parametrize("seed", range(3))
def test_walls_are_as_thin_as_cells(seed):
    """Area of the occupied cells against what the visible faces of the walls fill."""
    noise = INITIAL._replace(along=0.02**2)  # at 3 m what is usual at 6 m
    parts, poses = noisy_room(seed, 0.02)
    walls = walls_of(parts, poses, CONFIG.refine, noise)
    drawn = redraw_map(poses, dict(enumerate(parts)), walls, noise, CONFIG, THREADS)
    counted = ParticleMaps(1, CONFIG.map, THREADS)
    for pose, scan in zip(poses, parts, strict=True):
        counted.integrate_scan(pose[None], scan)
    length = np.linalg.norm(WALLS[:, 2:] - WALLS[:, :2], axis=1).sum()
    thin, thick = (grid.occupied.sum() * CONFIG.map.cell**2 / length for grid in (drawn, counted.occupancy(0)))
    assert thin < 1.3 * CONFIG.map.cell
    assert thick > 2.0 * CONFIG.map.cell  # the same scans, counted where they end
