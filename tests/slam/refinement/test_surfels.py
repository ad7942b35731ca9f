# SPDX-License-Identifier: MIT
"""Surfels: where they lie, which way they face, and what is kept apart."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam._threads import Threads
from slam.config import RefineConfig
from slam.refinement.noise import INITIAL, Noise
from slam.refinement.surfels import find_surfels, make_cells, make_cloud, transform_cloud
from slam.sensor.rays import make_rays
from tests.slam.rooms import WALLS, drive, rays, scan_at

CONFIG = RefineConfig()


def surfels_of(parts, poses, noise=INITIAL, threads=1):
    """Surfels of scans given as `Rays`, taken at poses (scans, 3)."""
    workers = Threads(threads)
    cloud = make_cloud(parts, CONFIG.max_points)
    there = transform_cloud(cloud, np.asarray(poses, dtype=np.float64), workers)
    cells, cell_of = make_cells(there.points, CONFIG.cell)
    return find_surfels(there, cloud, cells, cell_of, CONFIG, (noise, noise), 0.5, workers)


def in_the_room(threads=1):
    poses = drive(8, distance=0.15)
    return surfels_of(
        [make_rays([scan_at(pose, beams=360)], usable_range=20.0) for pose in poses], poses, threads=threads
    )


def distances_to_walls(points):
    """Distances of points (n, 2) from the walls of the room (n, walls), and the walls' normals into it (walls, 2)."""
    start, along = WALLS[:, :2], WALLS[:, 2:] - WALLS[:, :2]
    share = np.clip(np.sum((points[:, None] - start) * along, axis=-1) / np.sum(along**2, axis=-1), 0.0, 1.0)
    inwards = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.linalg.norm(along, axis=-1)[:, None]
    return np.linalg.norm(points[:, None] - (start + share[..., None] * along), axis=-1), inwards


def test_surfels_lie_on_the_walls_and_face_the_room():
    surfels = in_the_room()
    off, inwards = distances_to_walls(surfels.point)
    wall = off.argmin(axis=1)
    assert set(wall) == set(range(len(WALLS)))
    np.testing.assert_allclose(np.linalg.norm(surfels.normal, axis=1), 1.0, atol=1e-12)
    flat = np.sum(surfels.normal * inwards[wall], axis=1)
    right = (off.min(axis=1) < 0.002) & (flat > 0.999)  # about a corner a window may hold a bit of the other wall
    assert right.mean() > 0.8
    assert off.min(axis=1).max() < 0.03
    assert flat.min() > 0.9


def test_surfels_are_spread_over_the_walls():
    surfels = in_the_room()
    wall = distances_to_walls(surfels.point)[0].argmin(axis=1)
    for k, (start, end) in enumerate(zip(WALLS[:, :2], WALLS[:, 2:], strict=True)):
        length = np.linalg.norm(end - start)
        at = np.sort((surfels.point[wall == k] - start) @ (end - start) / length)
        gaps = np.diff(at)
        assert gaps.min() >= CONFIG.spacing - 1e-9
        assert gaps.max() <= 2.0 * CONFIG.spacing + CONFIG.cell
        assert at[0] < 0.4
        assert at[-1] > length - 0.4


def test_same_surfels_with_any_number_of_threads():
    one, other = in_the_room(1), in_the_room(3)
    for field in ("point", "normal", "first", "items"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))


def test_the_two_faces_of_a_thin_wall_are_kept_apart():
    y = np.linspace(-1.0, 1.0, 81)
    left = rays(np.stack([np.full(81, 2.0), y], axis=-1))
    right = rays(np.stack([np.full(81, 1.94), y], axis=-1))  # seen by a robot at x = 4 that looks back
    surfels = surfels_of([left, right], [(0.0, 0.0, 0.0), (4.0, 0.0, np.pi)])
    facing_left = surfels.normal[:, 0] < 0.0
    np.testing.assert_allclose(surfels.point[facing_left, 0], 2.0, atol=1e-6)
    np.testing.assert_allclose(surfels.point[~facing_left, 0], 2.06, atol=1e-6)
    assert 4 <= facing_left.sum() <= 9
    assert 4 <= (~facing_left).sum() <= 9


def test_near_end_points_count_more_than_far_ones():
    y = np.linspace(-1.0, 1.0, 81)
    near, far = np.stack([np.full(81, 1.0), y], axis=-1), np.stack([np.full(81, 10.06), y], axis=-1)
    noise = Noise(0.01**2, 0.01**2, 0.0, 0.0)  # 1.4 cm near by, 10 cm far off
    surfels = surfels_of([rays(near), rays(far)], [(0.0, 0.0, 0.0), (-9.0, 0.0, 0.0)], noise)
    expected = 0.06 / (1.0 + (0.01**2 + 0.1006**2) / (0.01**2 + 0.01**2))
    middle = np.abs(surfels.point[:, 1]) < 0.6  # towards the ends the ranges differ
    off = surfels.point[middle, 0] - 1.0
    assert off.max() < expected
    assert off.min() > 0.6 * expected  # the round window holds fewer cells of the farther line


def test_scattered_points_make_no_surfels():
    rng = np.random.default_rng(0)
    blob = rays(np.array([2.0, 0.0]) + 0.3 * rng.uniform(-1.0, 1.0, size=(2000, 2)))
    inside = surfels_of([blob], [(0.0, 0.0, 0.0)]).point
    assert not np.any(np.abs(inside - (2.0, 0.0)).max(axis=1) < 0.1)


@pytest.mark.parametrize("scans", [1, 60])
def test_stray_readings_in_a_line_are_a_wall_in_a_short_recording_only(scans):
    wall = np.stack([np.full(401, 2.0), np.linspace(-2.0, 2.0, 401)], axis=-1)
    stray = np.array([(1.0, -0.05), (1.0, 0.0), (1.0, 0.05)])  # all in one scan
    surfels = surfels_of([rays(np.concatenate([wall, stray])), *[rays(wall)] * (scans - 1)], np.zeros((scans, 3)))
    assert np.any(np.abs(surfels.point[:, 0] - 1.0) < 0.1) == (scans == 1)
    assert np.sum(np.abs(surfels.point[:, 0] - 2.0) < 0.01) > 10


@given(st.integers(1, 200), st.integers(0, 10**6), st.sampled_from([0.03, 0.05, 0.2]))
@settings(deadline=None)
def test_each_point_lies_in_its_cell(n, seed, side):
    points = np.random.default_rng(seed).normal(scale=5.0, size=(n, 2))
    cells, cell_of = make_cells(points, side)
    low = cells.corner + cells.coordinates[cell_of] * side
    assert np.all(points >= low - 1e-9)
    assert np.all(points <= low + side + 1e-9)
    assert len(np.unique(cells.coordinates, axis=0)) == len(cells.coordinates) == len(np.unique(cell_of))


def test_long_recordings_are_thinned_evenly():
    part = rays(np.stack([np.full(100, 2.0), np.linspace(-1.0, 1.0, 100)], axis=-1))
    cloud = make_cloud([part] * 7, 250)
    assert (len(cloud.ends), cloud.each) == (234, 3.0)  # every third one of all
    assert set(np.diff(cloud.first)) == {33, 34}
    assert len(np.unique(cloud.ends[:, 1])) == 100  # other directions from scan to scan
    np.testing.assert_allclose(cloud.ranges, np.hypot(*cloud.ends.T))
    whole = make_cloud([part] * 7, 700)
    assert len(whole.ends) == 700
    poses = np.array([(0.0, 0.0, 0.3)] * 7)
    np.testing.assert_allclose(
        transform_cloud(whole, poses, Threads(2)).points[:100], se2.transform_points((0.0, 0.0, 0.3), part.ends)
    )
