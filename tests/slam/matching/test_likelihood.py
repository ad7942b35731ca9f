# SPDX-License-Identifier: MIT
"""The cost of a pose: against the slow reference, and its derivatives against differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from slam import se2
from slam._planar_kernels import cholesky, solve
from slam.config import MotionConfig
from slam.matching._gauss_newton_kernels import gauss_newton
from slam.matching._likelihood_kernels import end_points, linearise_scan, scan_costs, wall_distances, walls_of
from slam.matching.likelihood import BeamModel
from slam.motion._odometry_model_kernels import linearise_motion, motion_cost
from slam.motion.odometry_model import motion_prior
from slam.sensor.rays import make_rays
from tests.slam import reference
from tests.slam.rooms import drive, empty_maps, scan_at
from tests.slam.strategies import poses

MODEL = BeamModel(per_sigma2=0.05**-2, per_outlier2=0.3**-2, weight=0.2, far=0.4)
BEAMS = reference.Beams(sigma=0.05, outlier=0.3, weight=0.2, far=0.4)
MOTION = MotionConfig(failure_share=0.1, failure_along=0.8, failure_limit=0.3)
FAR_AWAY = np.array([(2.0, 1.0, 0.4), (100.0, 0.0, 0.0)])
ASTRAY = np.array([0.2, 0.1, 0.0])
SURE = MotionConfig(failure_share=0.0, jump_share=0.0)


@pytest.fixture(scope="module")
def room():
    """Maps of a few scans, as the filter and as the reference keeps them, and the hits of one more scan."""
    maps = empty_maps(cell=0.05, wall_share=0.25, field_radius=0.4)
    naive = reference.Map(cell=0.05, wall_share=0.25, radius=8)
    for truth in drive(3):
        rays = make_rays([scan_at(truth, beams=360)], usable_range=80.0)
        maps.integrate_scan(truth[None], rays)
        naive.integrate_scan(truth, rays)
    last = drive(3)[-1]
    hits = make_rays([scan_at(last, beams=61)], usable_range=80.0).ends
    return maps.grids, naive, last, np.ascontiguousarray(hits)


def cost_at(grids, pose, hits):
    cost = np.empty(1)
    scan_costs(walls_of(grids, 0), np.array([pose]), end_points(hits), MODEL, cost)
    return cost[0]


def linearised(grids, pose, hits):
    H, g = np.zeros((3, 3)), np.zeros(3)
    cost, near = linearise_scan(walls_of(grids, 0), end_points(hits), *pose, MODEL, H, g)
    return cost, near, H, g


def differences(function, pose, step=1e-6):
    """Forward and backward differences of a function of a pose (3,), (2, 3, ...)."""
    here = function(pose)
    ahead = [(function(pose + step * axis) - here) / step for axis in np.eye(3)]
    back = [(here - function(pose - step * axis)) / step for axis in np.eye(3)]
    return np.array([ahead, back])


def near_poses(pose, count, seed=0):
    scale = (0.08, 0.08, 0.05)
    return pose + np.random.default_rng(seed).normal(scale=scale, size=(count, 3))


def test_scan_cost_is_that_of_the_reference(room):
    """To the rounding of mean end points to 1/4096 cell; normals lie in the same of 255 directions."""
    grids, naive, last, hits = room
    for pose in [last, *near_poses(last, 15), *(last + FAR_AWAY)]:
        expected = BEAMS.cost(naive, pose, hits)
        assert cost_at(grids, pose, hits) == pytest.approx(expected, rel=0.003, abs=0.01)


def test_matched_beams_are_those_of_the_reference(room):
    grids, naive, last, hits = room
    for pose in near_poses(last, 10, seed=1):
        assert linearised(grids, pose, hits)[1] == round(BEAMS.matched(naive, pose, hits) * len(hits))


def test_a_beam_at_a_known_distance_from_a_lone_point():
    maps = empty_maps(cell=0.1, field_radius=0.4)
    maps.integrate_scan(np.zeros((1, 3)), make_rays([scan_at((0.0, 0.0, 0.0), beams=1)], usable_range=80.0))
    point = make_rays([scan_at((0.0, 0.0, 0.0), beams=1)], usable_range=80.0).ends
    for away in (0.0, 0.1, 0.25):
        e = away**2
        expected = 0.5 * 0.2 / 0.05**2 * e / (1.0 + e / 0.3**2)
        assert cost_at(maps.grids, (0.0, away, 0.0), point) == pytest.approx(expected, rel=1e-3, abs=1e-5)
    far = 0.5 * 0.2 / 0.05**2 * 0.16 / (1.0 + 0.16 / 0.09)
    assert cost_at(maps.grids, (0.0, 0.8, 0.0), point) == pytest.approx(far)


def test_gradient_of_the_scan(room):
    grids, _, last, hits = room
    smooth = 0
    for pose in near_poses(last, 40, seed=2):
        ahead, back = differences(lambda p: cost_at(grids, p, hits), pose)
        cost, _, _, g = linearised(grids, pose, hits)
        assert cost == pytest.approx(cost_at(grids, pose, hits))
        if np.allclose(ahead, back, rtol=1e-3, atol=0.05):  # no beam changes its piece of wall just here
            smooth += 1
            np.testing.assert_allclose(g, 0.5 * (ahead + back), rtol=1e-4, atol=1e-3)
    assert smooth >= 35


def test_hessian_of_the_scan_is_gauss_newtons(room):
    """J^T W J of the distances across and beyond the ends of the walls, J by differences."""
    grids, _, last, hits = room

    def distances(pose):
        out = np.empty((4, len(hits)))
        wall_distances(grids, 0, *pose, hits, MODEL.far, out)
        return out[:2]

    smooth = 0
    for pose in near_poses(last, 40, seed=3):
        ahead, back = differences(distances, pose)
        if not np.allclose(ahead, back, atol=1e-3):
            continue
        smooth += 1
        J = 0.5 * (ahead + back)  # (3, 2, K)
        e = (distances(pose) ** 2).sum(axis=0)
        w = (1.0 + e * MODEL.per_outlier2) ** -2.0
        expected = MODEL.weight * MODEL.per_sigma2 * np.einsum("ark,brk,k->ab", J, J, w)
        np.testing.assert_allclose(linearised(grids, pose, hits)[2], expected, rtol=1e-3, atol=1e-2)
    assert smooth >= 30


def test_linearisations_are_added_to_what_is_there(room):
    grids, _, last, hits = room
    _, _, H, g = linearised(grids, last, hits)
    more_H, more_g = np.eye(3), np.ones(3)
    linearise_scan(walls_of(grids, 0), end_points(hits), *last, MODEL, more_H, more_g)
    np.testing.assert_allclose(more_H, H + np.eye(3))
    np.testing.assert_allclose(more_g, g + 1.0)


def from_guess(guess, deviation):
    return se2.compose(guess, deviation)


DEVIATIONS = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.2, 0.2), st.floats(-0.3, 0.3))
MOTIONS = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.1, 0.1), st.floats(-1.0, 1.0))


@given(poses(), DEVIATIONS, MOTIONS)
@settings(deadline=None)
def test_motion_cost_is_that_of_the_reference(guess, deviation, motion):
    cost = motion_cost(motion_prior(motion, MOTION), guess, *from_guess(guess, deviation))
    expected = reference.motion_cost(deviation, reference.sigmas(motion, MOTION), reference.shares(MOTION))
    assert cost == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(DEVIATIONS, MOTIONS, st.floats(-3.0, 3.0))
@settings(deadline=None)
def test_derivatives_of_the_motion_model(deviation, motion, heading):
    guess = np.array([1.0, -2.0, heading])
    prior = motion_prior(motion, MOTION)
    pose = from_guess(guess, deviation)
    H, g = np.zeros((3, 3)), np.zeros(3)
    cost = linearise_motion(prior, guess, *pose, H, g)
    assert cost == pytest.approx(motion_cost(prior, guess, *pose))
    ahead, back = differences(lambda p: motion_cost(prior, guess, *p), pose)
    np.testing.assert_allclose(g, 0.5 * (ahead + back), rtol=1e-3, atol=1e-2)
    assert np.all(np.linalg.eigvalsh(H) > 0.0)
    np.testing.assert_array_equal(H, H.T)


@given(DEVIATIONS, MOTIONS, st.floats(-3.0, 3.0))
@settings(deadline=None)
def test_hessian_of_a_single_gaussian_is_exact(deviation, motion, heading):
    guess = np.array([1.0, -2.0, heading])
    prior = motion_prior(motion, SURE)

    def gradient(pose):
        g = np.zeros(3)
        linearise_motion(prior, guess, *pose, np.zeros((3, 3)), g)
        return g

    H = np.zeros((3, 3))
    pose = from_guess(guess, deviation)
    linearise_motion(prior, guess, *pose, H, np.zeros(3))
    ahead, back = differences(gradient, pose, step=1e-5)
    np.testing.assert_allclose(H, 0.5 * (ahead + back), rtol=1e-4, atol=1e-3 * H.max())


def test_hessian_of_the_mixture_weighs_the_gaussians_by_their_shares():
    motion, deviation = (0.3, 0.0, 0.1), (0.2, 0.02, 0.01)
    prior = motion_prior(motion, MOTION)
    H = np.zeros((3, 3))
    linearise_motion(prior, np.zeros(3), *deviation, H, np.zeros(3))
    sigma = reference.sigmas(motion, MOTION)
    density = (
        reference.shares(MOTION) * np.exp(-0.5 * ((np.array(deviation) / sigma) ** 2).sum(axis=1)) / sigma.prod(axis=1)
    )
    np.testing.assert_allclose(H, np.diag(density @ sigma**-2.0) / density.sum(), rtol=1e-9)


@given(st.integers(0, 10**6))
@settings(deadline=None)
def test_cholesky_and_solve_against_numpy(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    A = root @ root.T + 0.01 * np.eye(3)
    L, b = np.empty((3, 3)), rng.normal(size=3)
    assert cholesky(A, L)
    np.testing.assert_allclose(L, np.linalg.cholesky(A), atol=1e-9)
    x = b.copy()
    solve(L, x)
    np.testing.assert_allclose(A @ x, b, atol=1e-7)


@pytest.mark.parametrize("A", [np.diag([1.0, -1.0, 1.0]), np.zeros((3, 3)), np.full((3, 3), np.nan)])
def test_cholesky_refuses_what_is_not_positive_definite(A):
    assert not cholesky(A, np.empty((3, 3)))


def test_descent_finds_the_way_back_to_the_truth(room):
    """From 0.1 m and 3 degrees away, with an odometry that knows little."""
    grids, _, last, hits = room
    prior = motion_prior((1.0, 0.0, 1.0), SURE)
    for start in last + np.random.default_rng(4).uniform(-1.0, 1.0, (10, 3)) * (0.1, 0.1, 0.05):
        pose, L = np.empty(3), np.empty((3, 3))
        cost, near = gauss_newton(walls_of(grids, 0), last, start, (end_points(hits), MODEL, prior), 30, pose, L)
        np.testing.assert_allclose(pose, last, atol=0.012)  # a quarter of a cell
        assert near == len(hits)
        assert cost == pytest.approx(cost_at(grids, pose, hits) + motion_cost(prior, last, *pose), abs=0.005)
        H = np.zeros((3, 3))
        linearise_motion(prior, last, *pose, H, np.zeros(3))
        linearise_scan(walls_of(grids, 0), end_points(hits), *pose, MODEL, H, np.zeros(3))
        scale = np.sqrt(np.outer(np.diag(H), np.diag(H)))
        np.testing.assert_allclose(L @ L.T / scale, H / scale, atol=0.05)  # a millimetre away
        lowest = minimize(  # no derivatives, so that it does not mind where beams change their piece of wall
            lambda p: cost_at(grids, p, hits) + motion_cost(prior, last, *p), pose, method="Nelder-Mead"
        )
        assert cost <= lowest.fun + 0.5
        assert np.linalg.norm(L.T @ (pose - lowest.x)) < 1.0  # in standard deviations of the posterior


def test_descent_never_ends_above_where_it_began(room):
    grids, _, last, hits = room
    prior = motion_prior((0.3, 0.0, 0.1), MOTION)
    for start in near_poses(last + ASTRAY, 20, seed=5):
        pose, L = np.empty(3), np.empty((3, 3))
        cost, _ = gauss_newton(walls_of(grids, 0), last, start, (end_points(hits), MODEL, prior), 20, pose, L)
        assert cost <= cost_at(grids, start, hits) + motion_cost(prior, last, *start) + 1e-9
