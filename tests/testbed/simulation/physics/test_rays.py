# SPDX-License-Identifier: MIT
"""The segment grid against a ray caster that tries every segment, and against PyBullet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.presets import load_robot
from testbed.simulation.physics._ray_kernels import cast_rays
from testbed.simulation.physics.backend import AccelerationLimits
from testbed.simulation.physics.fast import FastBackend, segment_grid
from tests.testbed.simulation.small_worlds import random_world, room
from worlds import Wall

LIMITS = AccelerationLimits(0.5, 3.0)


def nearest_of_all(segments, origins, directions, reach):
    """Distances by solving origin + t u = a + s (b - a) for every ray and segment."""
    u = np.stack([np.cos(directions), np.sin(directions)], axis=-1)[:, None]
    a, e = segments[None, :, :2], segments[None, :, 2:] - segments[None, :, :2]
    denominator = u[..., 0] * e[..., 1] - u[..., 1] * e[..., 0]
    w = a - origins[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (w[..., 0] * e[..., 1] - w[..., 1] * e[..., 0]) / denominator
        s = (w[..., 0] * u[..., 1] - w[..., 1] * u[..., 0]) / denominator
    t = np.where((t >= 0) & (s >= 0) & (s <= 1), t, np.inf).min(axis=1)
    return np.where(t <= reach, t, np.inf)


def distance_to_corners(segments, origins, directions):
    """Distance of each ray's line to the nearest end of a segment [m]."""
    ends = np.unique(segments.reshape(-1, 2), axis=0)
    w = ends[None] - origins[:, None]
    u = np.stack([np.cos(directions), np.sin(directions)], axis=-1)[:, None]
    along = (w * u).sum(-1)
    across = np.abs(w[..., 0] * u[..., 1] - w[..., 1] * u[..., 0])
    return np.where(along > 0, across, np.inf).min(axis=1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("cell", [0.3, 1.0, 50.0])
def test_grid_gives_what_trying_every_segment_gives(seed, cell):
    rng = np.random.default_rng(seed)
    segments = rng.uniform(-8, 8, (60, 4))
    origins, directions = rng.uniform(-8, 8, (300, 2)), rng.uniform(-4, 4, 300)
    expected = nearest_of_all(segments, origins, directions, 12.0)
    distances, _ = cast_rays(segment_grid(segments, cell), origins, directions, 12.0)
    apart = distance_to_corners(segments, origins, directions) > 1e-8
    np.testing.assert_allclose(distances[apart], expected[apart], atol=1e-9)


@given(st.integers(-40, 40), st.integers(-40, 40), st.integers(0, 71))
@settings(max_examples=300, deadline=None)
def test_no_ray_leaves_a_closed_room(x, y, turn):
    grid = segment_grid(room().boundary_segments())
    at, direction = np.array([[x / 10, y / 10]]), np.array([turn * np.pi / 36])
    distances, _ = cast_rays(grid, at, direction, 50.0)
    assert np.isfinite(distances[0])
    hit = at[0] + distances[0] * np.array([np.cos(direction[0]), np.sin(direction[0])])
    assert np.abs(hit).max() == pytest.approx(5.0, abs=1e-9)


def test_ranges_and_incidence_of_a_plain_wall_are_exact():
    grid = segment_grid(np.array([[2.0, -10.0, 2.0, 10.0], [-9.0, -1.0, -9.0, 1.0]]))
    directions = np.radians([0.0, 30.0, -60.0, 180.0, 90.0])
    distances, cos_incidence = cast_rays(grid, np.zeros((5, 2)), directions, 5.0)
    np.testing.assert_allclose(distances, [2.0, 2.0 / np.cos(np.pi / 6), 4.0, np.inf, np.inf], rtol=1e-12)
    np.testing.assert_allclose(cos_incidence[:3], np.cos(np.radians([0.0, 30.0, 60.0])), rtol=1e-12)


def test_nothing_is_seen_beyond_the_reach_or_from_off_the_grid():
    grid = segment_grid(np.array([[2.0, -1.0, 2.0, 1.0]]))
    assert cast_rays(grid, np.zeros((1, 2)), np.zeros(1), 1.999)[0][0] == np.inf
    assert cast_rays(grid, np.full((1, 2), 99.0), np.zeros(1), 500.0)[0][0] == np.inf


@pytest.mark.parametrize("seed", range(4))
def test_both_backends_see_the_same_world(seed):
    """99.9 % of the beams agree to 1 mm, all others pass a corner within 1 mm; medians agree to a micrometre."""
    pytest.importorskip("pybullet")
    pybullet_backend = pytest.importorskip("testbed.simulation.physics.pybullet")
    rng = np.random.default_rng(seed)
    world, robot = random_world(rng), load_robot("create3")
    origins = np.concatenate([rng.uniform(-0.8, 0.8, (20, 2)) for _ in range(360)])
    directions = rng.uniform(-np.pi, np.pi, len(origins))
    fast = FastBackend(world, robot, LIMITS).cast(origins, directions, 30.0, 0.19)
    backend = pybullet_backend.PyBulletBackend(world, robot, LIMITS)
    try:
        reference = backend.cast(origins, directions, 30.0, 0.19)
    finally:
        backend.close()
    error = np.abs(fast.distances - reference.distances)
    assert np.median(error) < 1e-6
    apart = error > 1e-3
    assert apart.mean() <= 1e-3
    corner = distance_to_corners(world.boundary_segments(0.19), origins, directions)
    assert np.all(corner[apart] < 1e-3)
    same_face = (error < 1e-6) & (corner > 0.05)
    np.testing.assert_allclose(fast.cos_incidence[same_face], reference.cos_incidence[same_face], atol=1e-3)


def test_glass_is_not_seen_by_either_backend():
    pytest.importorskip("pybullet")
    pybullet_backend = pytest.importorskip("testbed.simulation.physics.pybullet")
    world = room().model_copy(
        update={"walls": [*room().walls, Wall(points=[(2.0, -4.0), (2.0, 4.0)], glass=True, thickness=0.02)]}
    )
    robot, origin, ahead = load_robot("create3"), np.zeros((1, 2)), np.zeros(1)
    assert FastBackend(world, robot, LIMITS).cast(origin, ahead, 30.0, 0.19).distances[0] == pytest.approx(5.0)
    backend = pybullet_backend.PyBulletBackend(world, robot, LIMITS)
    assert backend.cast(origin, ahead, 30.0, 0.19).distances[0] == pytest.approx(5.0)
    assert backend.drive(0.4, 0.0, 240 * 8).contact  # the robot does not drive through it
    backend.close()


def test_more_rays_than_pybullet_takes_in_one_call():
    pytest.importorskip("pybullet")
    pybullet_backend = pytest.importorskip("testbed.simulation.physics.pybullet")
    backend = pybullet_backend.PyBulletBackend(room(), load_robot("create3"), LIMITS)
    n = 16_384
    hits = backend.cast(np.zeros((n, 2)), np.zeros(n), 30.0, 0.19)
    backend.close()
    np.testing.assert_allclose(hits.distances, 5.0, atol=1e-6)
