# SPDX-License-Identifier: MIT
"""The improved proposal: eta and the Gaussian against a fine integral of p(z | m, x) p(x | x', u)."""

import math

import numpy as np
import pytest

from slam import se2
from slam._planar_kernels import from_guess
from slam.config import MotionConfig
from slam.matching._gauss_newton_kernels import gauss_newton
from slam.matching._likelihood_kernels import end_points, scan_costs, walls_of
from slam.matching._proposal_kernels import (
    IMPROVED,
    MOTION,
    SCAN_MATCH,
    Laplace,
    draw_offset,
    fit_gaussian,
    propose,
    sample_motions,
)
from slam.matching._scan_matching_kernels import match_particles
from slam.matching.likelihood import BeamModel, ScanAndPrior
from slam.matching.proposal import Draws, ProposalResult, ProposalSettings, _uniform, first_errors, next_errors
from slam.matching.scan_matching import MatchSettings, empty_matches
from slam.motion._odometry_model_kernels import motion_cost
from slam.motion.odometry_model import MotionPrior, motion_prior
from slam.sensor.rays import make_rays
from tests.slam import reference
from tests.slam.rooms import drive, empty_maps, rays, scan_at

MODEL = BeamModel(per_sigma2=0.05**-2, per_outlier2=0.3**-2, weight=0.2, far=0.4)
WEAK = MODEL._replace(weight=0.02)
MIXTURE = MotionConfig(failure_share=0.1, failure_along=0.5, failure_limit=0.2)
JUMPY = MotionConfig(failure_share=0.1, failure_along=0.5, failure_limit=0.2, jump_share=0.05)
SPREAD = 1.2
NOT_EVEN = np.zeros(3)
INTERVAL = np.array([0.03, 0.02, 0.01])


@pytest.fixture(scope="module")
def room():
    """GridArrays of a few scans and the hits of one more."""
    maps = empty_maps(cell=0.05, field_radius=0.4)
    path = drive(4)
    for truth in path[:4]:
        maps.integrate_scan(truth[None], make_rays([scan_at(truth, beams=720)], usable_range=80.0))
    hits = make_rays([scan_at(path[4], beams=61)], usable_range=80.0).ends
    return maps.grids, path[4], np.ascontiguousarray(hits)


def costs_of(grids, particle, poses, hits, model):
    """Costs of a scan at poses (n, 3), (n,)."""
    out = np.empty(len(poses))
    scan_costs(walls_of(grids, particle), poses, end_points(hits), model, out)
    return out


def optimum_of(grids, guess, hits, model, prior):
    pose, L = np.empty(3), np.empty((3, 3))
    gauss_newton(walls_of(grids, 0), guess, guess, (end_points(hits), model, prior), 30, pose, L)
    return pose, L


def integral(grids, guess, hits, model, prior, optimum, L):
    """log of the integral over poses, and mean (3,) and covariance (3, 3): a sum over a fine grid about the optimum."""
    axis = np.linspace(-6.0, 6.0, 29)  # in standard deviations of the Laplace approximation
    z = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    poses = optimum + z @ np.linalg.inv(L)  # columns of L^-T are the axes of the Laplace approximation
    logs = -costs_of(grids, 0, poses, hits, model) - [motion_cost(prior, guess, *p) for p in poses]
    weights = np.exp(logs - logs.max())
    volume = (axis[1] - axis[0]) ** 3 / np.linalg.det(L)
    mean = weights @ poses / weights.sum()
    away = poses - mean
    return logs.max() + math.log(weights.sum() * volume), mean, (weights[:, None] * away).T @ away / weights.sum()


CASES = {
    "odometry and scan agree": (MODEL, MotionConfig(failure_share=0.0), (0.0, 0.0, 0.0)),
    "scan corrects odometry": (MODEL, MotionConfig(failure_share=0.0), (0.05, -0.03, 0.03)),
    "odometry rules": (WEAK, MotionConfig(failure_share=0.0), (0.02, 0.01, 0.01)),
    "odometry may have failed": (MODEL, MIXTURE, (0.08, 0.01, 0.02)),
}


@pytest.fixture(params=CASES, scope="module")
def case(request, room):
    """Everything that a fit needs, and the truth of the integral."""
    grids, truth, hits = room
    model, config, off = CASES[request.param]
    guess = se2.compose(truth, off)
    prior = motion_prior((0.3, 0.0, 0.12), config)
    optimum, L = optimum_of(grids, guess, hits, model, prior)
    arguments = (walls_of(grids, 0), guess, (end_points(hits), model, prior), Laplace(optimum, L, SPREAD, NOT_EVEN))
    return arguments, integral(grids, guess, hits, model, prior, optimum, L)


def fitted(arguments, near):
    samples, weights, mean, covariance = np.empty_like(near), np.empty(len(near)), np.empty(3), np.empty((3, 3))
    return fit_gaussian(*arguments, near, samples, weights, mean, covariance), mean, covariance


def test_with_many_samples_eta_is_the_integral_and_the_gaussian_has_its_moments(case):
    arguments, (log_eta, mean, covariance) = case
    near = np.random.default_rng(0).standard_normal((20_000, 3))
    found, found_mean, found_covariance = fitted(arguments, near)
    deviation = np.sqrt(np.diag(covariance))
    assert found == pytest.approx(log_eta, abs=0.03)
    np.testing.assert_allclose((found_mean - mean) / deviation, 0.0, atol=0.05)
    np.testing.assert_allclose(
        found_covariance / np.outer(deviation, deviation), covariance / np.outer(deviation, deviation), atol=0.06
    )


def test_eta_of_few_samples_is_right_on_average(case):
    """Importance sampling does not favour any side, however few the samples."""
    arguments, (log_eta, _, _) = case
    rng = np.random.default_rng(1)
    ratios = np.array([math.exp(fitted(arguments, rng.standard_normal((20, 3)))[0] - log_eta) for _ in range(600)])
    assert ratios.mean() == pytest.approx(1.0, abs=4.5 * ratios.std() / math.sqrt(len(ratios)) + 0.02)
    assert ratios.std() < 0.6


def test_offsets_have_the_covariance_of_the_laplace_approximation():
    L = np.linalg.cholesky(np.array([[9.0, 2.0, 1.0], [2.0, 6.0, -1.0], [1.0, -1.0, 4.0]]))
    z = np.random.default_rng(2).standard_normal((20_000, 3))
    offsets = np.empty_like(z)
    for k in range(len(z)):
        draw_offset(L, z[k], 1.2, offsets[k])
    np.testing.assert_allclose(np.cov(offsets.T), 1.44 * np.linalg.inv(L @ L.T), atol=0.01)
    np.testing.assert_allclose(offsets @ L, 1.2 * z, atol=1e-12)


def proposed(
    grids, hits, guesses, kind, *, prior, seed=0, model=MODEL, fail_share=0.1, half_width=NOT_EVEN, scatter=1.0
):
    """scatter: of the 20 poses about the optimum, in units of what it should be"""
    n = len(guesses)
    rng = np.random.default_rng(seed)
    near, normal = scatter * rng.standard_normal((20, 3)), rng.standard_normal((n, 3))
    draws = Draws(near, normal, normal, *rng.uniform(size=(2, n)))
    out = ProposalResult(
        np.full((n, 3), np.nan), np.full(n, np.nan), np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan),
        normal, np.full(n, np.nan), np.zeros(n, bool), np.zeros((n, 20, 3)), np.zeros((n, 20)),
    )  # fmt: skip
    evidence, search = ScanAndPrior(hits, model, prior), MatchSettings(20, np.zeros((0, 3)), model, hits)
    sampled, matches = np.empty((n, 3)), empty_matches(n)
    sample_motions(0, n, guesses, prior, draws, sampled)
    match_particles(0, n, grids, sampled if kind == SCAN_MATCH else guesses, evidence, search, matches)
    settings = ProposalSettings(kind, fail_share, SPREAD, half_width)
    propose(0, n, grids, guesses, evidence, settings, sampled, matches, draws, out)
    return out, draws


def repeated(maps_room, n):
    """GridArrays in which all n particles share one map."""
    grids, truth, hits = maps_room
    tables = ("table", "surface_table", "field_table")
    return grids._replace(**{name: np.repeat(getattr(grids, name)[:1], n, axis=0) for name in tables}), truth, hits


def test_motion_proposal_has_the_moments_of_the_motion_model(room):
    n = 20_000
    grids, truth, hits = repeated(room, n)
    motion = (0.4, 0.0, 0.3)
    prior = motion_prior(motion, JUMPY)
    out, _ = proposed(grids, hits[:1], np.tile(truth, (n, 1)), MOTION, prior=prior)
    deviations = se2.between(truth, out.pose)
    sigma = reference.sigmas(motion, JUMPY)
    expected = np.array([0.85, 0.1, 0.05]) @ sigma**2
    np.testing.assert_allclose(deviations.mean(axis=0) / np.sqrt(expected), 0.0, atol=4.5 / math.sqrt(n))
    np.testing.assert_allclose(np.cov(deviations.T) / expected, np.eye(3), atol=0.12)
    assert np.mean(deviations[:, 0] ** 4) / expected[0] ** 2 > 3.3  # heavier tails than one Gaussian


def test_each_kind_weighs_by_what_the_paper_says(room):
    """Likelihood at the new pose for `motion` and `scan-match`; for `improved` the integral, wherever the pose is."""
    n = 8
    grids, truth, hits = repeated(room, n)
    prior = motion_prior((0.3, 0.0, 0.12), MotionConfig(failure_share=0.0))
    guesses = truth + np.random.default_rng(3).normal(scale=(0.02, 0.02, 0.01), size=(n, 3))

    for kind in (MOTION, SCAN_MATCH):
        out, _ = proposed(grids, hits, guesses, kind, prior=prior)
        expected = [-costs_of(grids, i, out.pose[i : i + 1], hits, MODEL)[0] for i in range(n)]
        np.testing.assert_allclose(out.log_gain, expected)
        assert not out.failed.any()
        assert np.isnan(out.samples).all()

    out, draws = proposed(grids, hits, guesses, IMPROVED, prior=prior)
    for i in range(n):
        optimum, L = optimum_of(grids, guesses[i], hits, MODEL, prior)
        scan, laplace = (end_points(hits), MODEL, prior), Laplace(optimum, L, SPREAD, NOT_EVEN)
        log_eta, mean, covariance = fitted((walls_of(grids, i), guesses[i], scan, laplace), draws.near)
        assert out.log_gain[i] == pytest.approx(log_eta, abs=1e-3)
        expected = mean + np.linalg.cholesky(covariance) @ draws.error[i]
        np.testing.assert_allclose(out.pose[i], expected, atol=1e-4)


def test_the_gaussian_is_fitted_to_the_samples_that_are_reported(room):
    """Equations 16 and 17, from the samples alone: weights are the product over the density they were drawn from."""
    grids, truth, hits = repeated(room, 1)
    prior = motion_prior((0.3, 0.0, 0.12), MotionConfig(failure_share=0.0))
    guess = truth + np.array([0.02, -0.02, 0.01])
    out, draws = proposed(grids, hits, guess[None], IMPROVED, prior=prior)
    samples = out.samples[0]
    cost = costs_of(grids, 0, samples, hits, MODEL) + [motion_cost(prior, guess, *x) for x in samples]
    logs = 0.5 * (draws.near**2).sum(axis=1) - cost
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    np.testing.assert_allclose(out.sample_weights[0], weights, atol=1e-12)
    np.testing.assert_allclose(weights @ samples, out.mean[0], atol=1e-9)
    away = samples - out.mean[0]
    np.testing.assert_allclose((weights[:, None] * away).T @ away, out.covariance[0], atol=1e-12)


def test_poses_without_scatter_leave_the_gaussian_of_the_optimum(room):
    """All poses the same: their covariance is zero, which no pose can be drawn from."""
    n = 3
    grids, truth, hits = repeated(room, n)
    prior = motion_prior((0.3, 0.0, 0.12), MotionConfig(failure_share=0.0))
    guesses = truth + np.array([[0.02, -0.02, 0.01], [0.0, 0.03, -0.01], [-0.01, 0.0, 0.02]])
    out, draws = proposed(grids, hits, guesses, IMPROVED, prior=prior, scatter=0.0)
    for i in range(n):
        optimum, L = optimum_of(grids, guesses[i], hits, MODEL, prior)
        expected = optimum + np.linalg.solve(L.T, draws.error[i])
        np.testing.assert_allclose(out.pose[i], expected, atol=1e-4)
        np.testing.assert_allclose(out.mean[i], optimum, atol=1e-4)


def fit_evenly(arguments, near, half_width):
    """Equations 16 to 18 by a loop over the poses, as the paper writes them: log eta, mean, covariance."""
    walls, guess, (points, model, prior), laplace = arguments
    poses = laplace.optimum + half_width * near
    costs = np.empty(len(poses))
    scan_costs(walls, poses, points, model, costs)
    logs = -costs - [motion_cost(prior, guess, *x) for x in poses]
    products = [math.exp(value - max(logs)) for value in logs]
    eta = sum(products)
    mean = sum(p * x for p, x in zip(products, poses, strict=True)) / eta
    covariance = sum(p * np.outer(x - mean, x - mean) for p, x in zip(products, poses, strict=True)) / eta
    volume_per_pose = np.prod(2.0 * half_width) / len(near)
    return max(logs) + math.log(eta * volume_per_pose), mean, covariance


def test_poses_that_are_drawn_evenly_give_the_sums_of_the_paper(case):
    arguments, _ = case
    arguments = (*arguments[:-1], arguments[-1]._replace(half_width=INTERVAL))
    near = np.random.default_rng(4).uniform(-1.0, 1.0, (20, 3))
    log_eta, mean, covariance = fitted(arguments, near)
    expected = fit_evenly(arguments, near, INTERVAL)
    assert log_eta == pytest.approx(expected[0], abs=1e-9)
    np.testing.assert_allclose(mean, expected[1], atol=1e-12)
    np.testing.assert_allclose(covariance, expected[2], atol=1e-15)


def test_with_many_poses_the_interval_gives_the_same_integral(case):
    """Both ways to draw estimate the integral of the product, if the interval is wide enough."""
    arguments, (log_eta, mean, covariance) = case
    wide = 5.0 * np.sqrt(np.diag(covariance))
    arguments = (*arguments[:-1], arguments[-1]._replace(half_width=wide))
    found, found_mean, _ = fitted(arguments, np.random.default_rng(5).uniform(-1.0, 1.0, (40_000, 3)))
    assert found == pytest.approx(log_eta, abs=0.05)
    np.testing.assert_allclose((found_mean - mean) / np.sqrt(np.diag(covariance)), 0.0, atol=0.08)


def test_the_poses_of_an_interval_lie_in_it(room):
    n = 4
    grids, truth, hits = repeated(room, n)
    prior = motion_prior((0.3, 0.0, 0.12), MotionConfig(failure_share=0.0))
    guesses = np.tile(truth, (n, 1))
    out, _ = proposed(grids, hits, guesses, IMPROVED, prior=prior, half_width=INTERVAL)
    optima = np.array([optimum_of(grids, guess, hits, MODEL, prior)[0] for guess in guesses])
    # these variates are normal: 68 % of them lie in (-1, 1)
    offsets = np.abs(out.samples - optima[:, None]) / INTERVAL
    assert np.mean(offsets < 1.0) == pytest.approx(0.68, abs=0.12)


def test_normal_variates_become_uniform_ones():
    uniform = _uniform(np.random.default_rng(6).standard_normal((20_000, 3)))
    assert np.abs(uniform).max() < 1.0
    np.testing.assert_allclose(np.quantile(uniform, [0.1, 0.5, 0.9]), [-0.8, 0.0, 0.8], atol=0.02)


def test_scan_match_proposes_the_optimum_about_its_sample(room):
    n = 8
    grids, truth, hits = repeated(room, n)
    prior = motion_prior((0.3, 0.0, 0.12), MotionConfig(failure_share=0.0))
    guesses = np.tile(truth + np.array([0.03, -0.03, 0.02]), (n, 1))
    out, _ = proposed(grids, hits, guesses, SCAN_MATCH, prior=prior)
    samples = proposed(grids, hits, guesses, MOTION, prior=prior)[0].pose
    for i in range(n):
        optimum, L = optimum_of(grids, samples[i], hits, MODEL, prior)
        np.testing.assert_array_equal(out.pose[i], optimum)
        np.testing.assert_allclose(out.covariance[i], np.linalg.inv(L @ L.T), rtol=1e-9)


def scattered(grids, hits, truth, kind):
    """Standard deviations of new poses along, across [m] and in heading [rad], all from one predicted pose."""
    prior = motion_prior((0.3, 0.0, 0.12), MotionConfig(failure_share=0.0))
    guesses = np.tile(truth, (len(grids.table), 1))
    out, _ = proposed(grids, hits, guesses, kind, prior=prior, model=MODEL._replace(weight=1.0))
    assert not out.failed.any()
    return se2.between(truth, out.pose).std(axis=0)


def test_scan_match_agrees_where_the_scan_determines_the_pose(room):
    grids, truth, hits = repeated(room, 200)
    ratio = scattered(grids, hits, truth, SCAN_MATCH) / scattered(grids, hits, truth, MOTION)
    assert np.all(ratio < 0.15)


def test_scan_match_keeps_the_scatter_of_the_motion_along_a_corridor():
    """Two parallel walls say nothing of the way along them."""
    maps = empty_maps(cell=0.05, field_radius=0.4)
    along = np.arange(-4.0, 4.0, 0.02)
    sides = np.concatenate([np.stack([along, np.full(len(along), y)], axis=-1) for y in (-1.03, 1.02)])
    for x in (-2.0, 0.0, 2.0):
        maps.integrate_scan(np.array([(x, 0.0, 0.0)]), rays(sides))
    grids, truth, hits = repeated((maps.grids, np.zeros(3), np.ascontiguousarray(sides[::13])), 200)
    ratio = scattered(grids, hits, truth, SCAN_MATCH) / scattered(grids, hits, truth, MOTION)
    assert ratio[0] == pytest.approx(1.0, abs=0.05)
    assert np.all(ratio[1:] < 0.15)


@pytest.mark.parametrize("kind", [SCAN_MATCH, IMPROVED])
def test_where_matching_fails_the_motion_model_is_sampled_and_the_likelihood_weighs(room, kind):
    """Lines 7 to 9 of Algorithm 1."""
    grids, truth, hits = repeated(room, 6)
    sigma = np.array([(0.05, 0.02, 0.03), (0.3, 0.1, 0.05), (0.4, 0.3, 0.5)])  # along, across, heading
    prior = MotionPrior(sigma**-2, np.zeros(3), np.array([1.0, 0.0, 0.0]))
    guesses = np.tile(truth, (6, 1))
    failed, _ = proposed(grids, hits, guesses, kind, prior=prior, fail_share=1.01)
    plain, _ = proposed(grids, hits, guesses, MOTION, prior=prior)
    assert failed.failed.all()
    assert np.isnan(failed.samples).all()
    np.testing.assert_array_equal(failed.pose, plain.pose)
    np.testing.assert_array_equal(failed.log_gain, plain.log_gain)
    np.testing.assert_allclose(failed.mean, guesses)
    turned = np.array([[math.cos(truth[2]), -math.sin(truth[2])], [math.sin(truth[2]), math.cos(truth[2])]])
    np.testing.assert_allclose(failed.covariance[0, :2, :2], turned @ np.diag(sigma[0, :2] ** 2) @ turned.T)
    assert failed.covariance[0, 2, 2] == pytest.approx(sigma[0, 2] ** 2)


def test_deviations_from_the_guess_are_in_its_frame():
    out = np.empty(3)
    from_guess(np.array([1.0, 2.0, 0.5 * math.pi]), 0.3, 0.1, math.pi, out)
    np.testing.assert_allclose(out, (0.9, 2.3, -0.5 * math.pi), atol=1e-12)


@pytest.mark.parametrize("weight", [0.07, 0.3, 1.0, 2.0])
def test_errors_of_poses_add_up_as_independent_ones_do_and_are_smaller(weight):
    """Variance: the beam weight, but at most 1; that of the mean of many: 1 / their number."""
    rng, count = np.random.default_rng(4), 400
    errors, series = first_errors(3000, weight, rng.bit_generator), []
    assert errors.shape == (3000, 3)
    assert np.var(errors) == pytest.approx(min(weight, 1.0), rel=0.05)
    for _ in range(count):
        errors = next_errors(errors, rng.standard_normal(errors.shape), weight)
        series.append(errors)
    assert np.var(series[-1]) == pytest.approx(min(weight, 1.0), rel=0.05)
    assert np.var(np.mean(series[100:], axis=0)) * (count - 100) == pytest.approx(1.0, rel=0.08)
    alike = np.corrcoef(series[-1].ravel(), series[-2].ravel())[0, 1]
    assert (abs(alike) < 0.04) == (weight >= 1.0)
