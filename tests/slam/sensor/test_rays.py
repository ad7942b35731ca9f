# SPDX-License-Identifier: MIT
"""From scans to rays: which beams are used, where they end, and the motion between them undone."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import Scan, se2
from slam.sensor.deskew import exp_twist
from slam.sensor.rays import BeamCounts, count_beams, make_rays

READINGS = np.array([1.0, 5.0, 10.0, math.inf, math.nan, -1.0, 0.0, 0.05])
ANGLES = np.array([0.0, math.pi / 2.0, math.pi, 0.1, 0.2, 0.3, 0.4, 0.5])


def scan(**changes):
    return Scan(**({"ranges": READINGS, "angles": ANGLES, "range_max": 8.0, "range_min": 0.1} | changes))


def pose_after(twist, seconds):
    """Independent of the product's closed form: the velocity in the first frame, integrated by Gauss and Legendre."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    heading = twist[2] * 0.5 * seconds * (nodes + 1.0)
    vx = np.cos(heading) * twist[0] - np.sin(heading) * twist[1]
    vy = np.sin(heading) * twist[0] + np.cos(heading) * twist[1]
    return np.array([0.5 * seconds * (weights @ vx), 0.5 * seconds * (weights @ vy), twist[2] * seconds])


def sightings(points, twist, seconds, mount, stamp=0.0, **extra):
    """Scan of points (n, 2) in the robot's frame at time 0, each seen at its own time (n,) by the moving robot."""
    seen = []
    for point, at in zip(points, seconds, strict=True):
        T_start_lidar = se2.compose(pose_after(twist, at), mount)
        seen.append(se2.transform_points(se2.inverse(T_start_lidar), point[None])[0])
    seen = np.array(seen)
    return Scan(
        ranges=np.hypot(seen[:, 0], seen[:, 1]),
        angles=np.arctan2(seen[:, 1], seen[:, 0]),
        range_max=100.0,
        stamp=stamp,
        mount=mount,
        time_offsets=seconds - stamp,
        **extra,
    )


def test_only_hits_become_rays():
    rays = make_rays([scan()], usable_range=80.0)
    np.testing.assert_allclose(rays.ends, [(1.0, 0.0), (0.0, 5.0)], atol=1e-12)
    assert rays.hit.all()
    np.testing.assert_array_equal(rays.origins, np.zeros((2, 2)))


def test_hits_beyond_the_usable_range_are_no_returns():
    assert len(make_rays([scan()], usable_range=2.0).hit) == 1
    rays = make_rays([scan()], usable_range=2.0, free_range=3.0)
    np.testing.assert_allclose(
        rays.ends, [(1.0, 0.0), (0.0, 3.0), (-3.0, 0.0), (3 * math.cos(0.1), 3 * math.sin(0.1))], atol=1e-12
    )
    assert rays.hit.tolist() == [True, False, False, False]


def test_readings_are_counted_by_kind():
    values = [1.0, 2.0, np.inf, 10.0, 12.0, np.nan, 0.0, -1.0, -np.inf, 0.05]
    angles = np.linspace(0.0, 1.0, len(values))
    scan = Scan(ranges=np.array(values), angles=angles, range_min=0.1, range_max=10.0)
    assert count_beams([scan]) == BeamCounts(hits=2, no_returns=3, invalid=5)
    aimless = Scan(ranges=np.array(values), angles=np.where(angles == 0.0, np.nan, angles), range_max=10.0)
    assert count_beams([aimless]) == BeamCounts(hits=2, no_returns=3, invalid=5)  # 0.05 for 1.0
    assert count_beams([scan, aimless]) == BeamCounts(4, 6, 10)
    assert count_beams([]) == BeamCounts(0, 0, 0)


def test_no_returns_clear_no_farther_than_the_lidar_sees():
    rays = make_rays([scan(range_max=4.0)], usable_range=80.0, free_range=30.0)
    assert np.hypot(*rays.ends[~rays.hit].T) == pytest.approx(np.full(3, 4.0))


def test_beams_without_a_direction_are_left_out():
    angles = ANGLES.copy()
    angles[0] = math.nan
    angles[2] = math.inf
    rays = make_rays([scan(angles=angles)], usable_range=80.0, free_range=1.0)
    assert len(rays.hit) == 2
    assert np.all(np.isfinite(rays.ends))


def test_mount_moves_origin_and_end():
    rays = make_rays([scan(mount=(0.3, -0.1, math.pi / 2.0))], usable_range=80.0)
    np.testing.assert_allclose(rays.origins, [(0.3, -0.1)] * 2)
    np.testing.assert_allclose(rays.ends, [(0.3, 0.9), (-4.7, -0.1)], atol=1e-12)


def test_a_lidar_upside_down_runs_clockwise_with_negated_angles():
    upright, turned = scan(), scan(angles=-ANGLES)
    ends = make_rays([upright], usable_range=80.0).ends
    np.testing.assert_allclose(make_rays([turned], usable_range=80.0).ends, ends * (1.0, -1.0), atol=1e-12)


def test_several_lidars_are_the_sum_of_each():
    front, rear = scan(mount=(0.2, 0.0, 0.0)), scan(ranges=READINGS[::-1].copy(), mount=(-0.2, 0.0, math.pi))
    both = make_rays([front, rear], usable_range=80.0, free_range=2.0)
    for name in ("origins", "ends", "hit"):
        alone = [getattr(make_rays([one], usable_range=80.0, free_range=2.0), name) for one in (front, rear)]
        np.testing.assert_array_equal(getattr(both, name), np.concatenate(alone))


def test_a_scan_of_no_beams_has_no_rays():
    assert make_rays([scan(ranges=np.empty(0), angles=np.empty(0))], usable_range=80.0).ends.shape == (0, 2)


TWISTS = st.tuples(st.floats(-2.0, 2.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0) | st.sampled_from([0.0, 1e-12]))


@given(TWISTS, st.floats(-2.0, 2.0))
@settings(deadline=None)
def test_displacement_is_the_integral_of_the_velocity(twist, seconds):
    expected = pose_after(twist, seconds)
    np.testing.assert_allclose(exp_twist(twist, seconds)[:2], expected[:2], atol=1e-9)
    assert float(se2.wrap_angle(exp_twist(twist, seconds)[2] - expected[2])) == pytest.approx(0.0, abs=1e-9)


@given(TWISTS, st.integers(0, 1000))
@settings(deadline=None, max_examples=25)
def test_deskewing_brings_every_point_back_to_where_it_was_at_the_first_beam(twist, seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(3.0, 9.0, (12, 2)) * rng.choice([-1.0, 1.0], (12, 2))
    front = sightings(points, twist, np.linspace(0.0, 0.2, 12), (0.2, 0.1, 0.5))
    later = sightings(points, twist, np.linspace(0.1, 0.3, 12), (-0.3, 0.0, math.pi), stamp=0.1)
    rays = make_rays([front, later], usable_range=80.0, twist=twist)
    np.testing.assert_allclose(rays.ends, np.concatenate([points, points]), atol=1e-9)
    at = [se2.compose(pose_after(twist, t), (0.2, 0.1, 0.5))[:2] for t in np.linspace(0.0, 0.2, 12)]
    np.testing.assert_allclose(rays.origins[:12], at, atol=1e-9)


def test_without_times_or_without_a_twist_nothing_is_undone():
    twist = (1.0, 0.0, 1.0)
    plain = make_rays([scan()], usable_range=80.0)
    np.testing.assert_array_equal(make_rays([scan()], usable_range=80.0, twist=twist).ends, plain.ends)
    timed = scan(time_offsets=np.linspace(0.0, 0.1, len(READINGS)))
    np.testing.assert_array_equal(make_rays([timed], usable_range=80.0).ends, plain.ends)
    assert np.abs(make_rays([timed], usable_range=80.0, twist=twist).ends - plain.ends).max() > 0.01


@pytest.mark.parametrize("twist", [(0.5, 0.0, 51.0), (0.5, 0.0, -13.0), (11.0, 0.0, 0.0), (0.0, -11.0, 0.0)])
def test_a_twist_that_no_robot_makes_bends_no_scan(twist):
    """As wheels report that slip within a scan: at 51 rad/s the last beam would be turned by 146 degrees."""
    np.testing.assert_array_equal(moving_ends(twist), moving_ends(None))


@pytest.mark.parametrize("twist", [(0.5, 0.0, 12.0), (9.0, 0.0, 0.0)])
def test_a_fast_robot_is_believed(twist):
    assert np.abs(moving_ends(twist) - moving_ends(None)).max() > 0.1


def moving_ends(twist):
    """End points of a wall 4 m away, seen within 50 ms at a twist."""
    angles = np.linspace(-1.0, 1.0, 50)
    moving = Scan(ranges=np.full(50, 4.0), angles=angles, range_max=20.0, time_offsets=np.linspace(0.0, 0.05, 50))
    return make_rays([moving], usable_range=20.0, twist=twist).ends
