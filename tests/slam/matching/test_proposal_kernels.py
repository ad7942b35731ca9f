# SPDX-License-Identifier: MIT
"""Each kernel of the proposal against its formula in numpy: few numbers, so that they can run as plain Python too."""

import math

import numpy as np
import pytest

from slam import se2
from slam.matching._likelihood_kernels import end_points, scan_costs, walls_of
from slam.matching._proposal_kernels import (
    IMPROVED,
    MOTION,
    SCAN_MATCH,
    Laplace,
    draw_near_optimum,
    draw_offset,
    draw_poses,
    fit_gaussian,
    log_density_at_optimum,
    propose,
    sample_motions,
)
from slam.matching.likelihood import BeamModel, ScanAndPrior
from slam.matching.proposal import Draws, ProposalResult, ProposalSettings
from slam.matching.scan_matching import Matches, empty_matches
from slam.motion._odometry_model_kernels import motion_cost
from slam.motion.odometry_model import MotionPrior
from slam.sensor.rays import make_rays
from tests.slam.rooms import drive, empty_maps, scan_at

MODEL = BeamModel(per_sigma2=0.05**-2, per_outlier2=0.3**-2, weight=0.2, far=0.4)
SPREAD, EVEN, NOT_EVEN = 1.3, np.array([0.03, 0.02, 0.05]), np.zeros(3)
HESSIAN = np.array([[900.0, 200.0, 100.0], [200.0, 600.0, -100.0], [100.0, -100.0, 400.0]])
FACTOR = np.linalg.cholesky(HESSIAN)
PRECISION = np.array([(400.0, 900.0, 1600.0), (25.0, 100.0, 400.0), (4.0, 9.0, 16.0)])
SHARE = np.array([0.6, 0.25, 0.15])
PRIOR = MotionPrior(PRECISION, np.log(SHARE) + 0.5 * np.log(PRECISION).sum(axis=1) - 1.5 * np.log(2 * np.pi), SHARE)
TURN = math.pi - 0.01 - drive(4)[4][2]
"""The room is turned by it, so that headings lie on both sides of pi."""
POSES, COUNT = 5, 4


@pytest.fixture(scope="module")
def room():
    """GridArrays of `COUNT` particles with one map, the true pose, and the hits of a scan."""
    maps, path = empty_maps(cell=0.05, field_radius=0.4), se2.compose((0.0, 0.0, TURN), drive(4))
    for truth, inside in zip(path[:4], drive(4)[:4], strict=True):
        maps.integrate_scan(truth[None], make_rays([scan_at(inside, beams=180)], usable_range=80.0))
    grids = maps.grids
    tables = ("table", "surface_table", "field_table")
    grids = grids._replace(**{name: np.repeat(getattr(grids, name)[:1], COUNT, axis=0) for name in tables})
    return grids, path[4], np.ascontiguousarray(make_rays([scan_at(drive(4)[4], beams=21)], usable_range=80.0).ends)


def laplace_at(pose, half_width):
    """The factor's other triangle is never to be read."""
    factor = np.where(np.tri(3) > 0, FACTOR, np.nan)
    return Laplace(np.asarray(pose), factor, SPREAD, half_width)


def costs_at(grids, particle, poses, hits):
    costs = np.empty(len(poses))
    scan_costs(walls_of(grids, particle), poses, end_points(hits), MODEL, costs)
    return costs


def variates(seed, *shape):
    return np.random.default_rng(seed).uniform(-0.95, 0.95, shape)


def test_an_offset_is_the_variates_over_the_factor():
    for z in variates(0, 5, 3):
        out = np.full(3, np.nan)
        draw_offset(laplace_at(np.zeros(3), NOT_EVEN).factor, z, SPREAD, out)
        np.testing.assert_allclose(out, SPREAD * np.linalg.solve(FACTOR.T, z), rtol=1e-12)


def log_normal(offset):
    """Log density of N(0, SPREAD^2 HESSIAN^-1)."""
    precision = HESSIAN / SPREAD**2
    return 0.5 * (np.linalg.slogdet(precision)[1] - offset @ precision @ offset - 3.0 * math.log(2.0 * math.pi))


def test_the_density_at_the_optimum_and_how_much_lower_it_is_at_a_pose():
    gaussian, even = (laplace_at(np.zeros(3), width) for width in (NOT_EVEN, EVEN))
    assert log_density_at_optimum(gaussian) == pytest.approx(log_normal(np.zeros(3)), rel=1e-12)
    assert log_density_at_optimum(even) == pytest.approx(-math.log(np.prod(2.0 * EVEN)), rel=1e-12)
    for z in variates(1, 5, 3):
        out = np.full(3, np.nan)
        below = draw_near_optimum(gaussian, z, out)
        assert below == pytest.approx(log_normal(np.zeros(3)) - log_normal(out), rel=1e-9)
        assert draw_near_optimum(even, z, out) == 0.0
        np.testing.assert_allclose(out, EVEN * z, rtol=1e-12)


@pytest.mark.parametrize("half_width", [NOT_EVEN, EVEN], ids=["gaussian", "even"])
def test_poses_are_the_optimum_and_their_offsets(half_width):
    optimum, near = np.array([1.0, -2.0, 3.0]), variates(2, POSES, 3)
    offsets, below, poses = np.full((POSES, 3), np.nan), np.full(POSES, np.nan), np.full((POSES, 3), np.nan)
    draw_poses(laplace_at(optimum, half_width), near, offsets, below, poses)
    expected = EVEN * near if half_width[0] else SPREAD * np.linalg.solve(FACTOR.T, near.T).T
    np.testing.assert_allclose(offsets, expected, rtol=1e-12)
    np.testing.assert_allclose(poses, optimum + expected, rtol=1e-12)
    np.testing.assert_allclose(below, 0.0 if half_width[0] else 0.5 * (near**2).sum(axis=1), rtol=1e-12)


def fit_of(grids, particle, hits, guess, optimum, near, half_width):
    """Equations 16 to 18 in numpy: log eta, mean, covariance, poses, their weights."""
    even = half_width[0] > 0.0
    offsets = half_width * near if even else SPREAD * np.linalg.solve(FACTOR.T, near.T).T
    poses = optimum + offsets
    costs = costs_at(grids, particle, poses, hits) + [motion_cost(PRIOR, guess, *pose) for pose in poses]
    log_q = np.full(POSES, -math.log(np.prod(2.0 * half_width))) if even else [log_normal(x) for x in offsets]
    ratio = -costs - log_q
    shares = np.exp(ratio - ratio.max())
    log_eta = ratio.max() + math.log(shares.mean())
    shares /= shares.sum()
    mean = shares @ poses
    covariance = (shares[:, None] * (poses - mean)).T @ (poses - mean)
    return log_eta, wrapped(mean), covariance, wrapped(poses), shares


def wrapped(poses):
    poses = np.array(poses)
    poses[..., 2] = (poses[..., 2] + math.pi) % (2.0 * math.pi) - math.pi
    return poses


@pytest.mark.parametrize("half_width", [NOT_EVEN, EVEN], ids=["gaussian", "even"])
@pytest.mark.parametrize("seed", [3, 4])
def test_the_gaussian_and_eta_are_the_sums_of_the_paper(room, half_width, seed):
    grids, truth, hits = room
    near = variates(seed, POSES, 3)
    guess, optimum = truth + np.array([0.03, -0.02, 0.015]), truth + np.array([0.01, -0.01, 0.004])
    samples, weights, mean, covariance = (np.full(n, np.nan) for n in ((POSES, 3), POSES, 3, (3, 3)))
    evidence = end_points(hits), MODEL, PRIOR
    log_eta = fit_gaussian(
        walls_of(grids, 0), guess, evidence, laplace_at(optimum, half_width), near, samples, weights, mean, covariance
    )
    expected = fit_of(grids, 0, hits, guess, optimum, near, half_width)
    for found, value in zip((log_eta, mean, covariance, samples, weights), expected, strict=True):
        np.testing.assert_allclose(found, value, rtol=1e-9, atol=1e-13)
    assert samples[:, 2].min() < 0.0 < samples[:, 2].max()  # on both sides of pi


def matches_at(optima, *, share=0.5, probability=None):
    matches: Matches = empty_matches(COUNT)
    matches.optimum[:], matches.factor[:], matches.matched[:] = optima, np.where(np.tri(3) > 0, FACTOR, np.nan), share
    matches.probability[:] = 1.0 if probability is None else probability
    return matches


def proposed(room, kind, *, matches, guesses, hits=None, half_width=NOT_EVEN, fail_share=0.5, near=None, span=(1, 3)):
    """What `propose` writes for particles [1, 3) of four."""
    grids, _, all_hits = room
    hits = all_hits if hits is None else hits
    near = variates(5, POSES, 3) if near is None else near
    draws = Draws(near, variates(6, COUNT, 3), 2.0 * variates(7, COUNT, 3), np.full(COUNT, 0.5), np.full(COUNT, 0.5))
    shapes = ((COUNT, 3), COUNT, (COUNT, 3), (COUNT, 3, 3), None, COUNT, None, (COUNT, POSES, 3), (COUNT, POSES))
    out = [np.full(shape, 7.0) if shape else None for shape in shapes]
    out[4], out[6] = draws.error, np.ones(COUNT, bool)
    out = ProposalResult(*out)
    sampled = guesses + 0.1 * variates(8, COUNT, 3)
    settings = ProposalSettings(kind, fail_share, SPREAD, half_width)
    propose(*span, grids, guesses, ScanAndPrior(hits, MODEL, PRIOR), settings, sampled, matches, draws, out)
    return out, draws, sampled


def around(truth, seed):
    return truth + variates(seed, COUNT, 3) * (0.02, 0.02, 0.01)


@pytest.mark.parametrize("half_width", [NOT_EVEN, EVEN], ids=["gaussian", "even"])
def test_an_improved_pose_is_drawn_from_the_gaussian_and_weighs_eta(room, half_width):
    grids, truth, hits = room
    guesses, optima = around(truth, 9), around(truth, 10)
    matches = matches_at(optima, probability=[1.0, 0.25, 0.6, 1.0])
    near = variates(11, POSES, 3)
    out, draws, _ = proposed(
        room, IMPROVED, matches=matches, guesses=guesses, half_width=half_width, near=near, fail_share=0.5
    )
    for i in (1, 2):
        log_eta, mean, covariance, poses, shares = fit_of(grids, i, hits, guesses[i], optima[i], near, half_width)
        assert out.log_gain[i] == pytest.approx(log_eta - math.log(matches.probability[i]), rel=1e-9)
        for found, value in ((out.mean, mean), (out.covariance, covariance), (out.samples, poses)):
            np.testing.assert_allclose(found[i], value, rtol=1e-9, atol=1e-13)
        np.testing.assert_allclose(out.sample_weights[i], shares, rtol=1e-9)
        expected = wrapped(mean + np.linalg.cholesky(covariance) @ draws.error[i])
        np.testing.assert_allclose(out.pose[i], expected, rtol=1e-9)
        assert (out.matched[i], out.failed[i]) == (0.5, False)  # a share just as large as it must be
    for name in ("pose", "log_gain", "mean", "covariance", "matched", "samples", "sample_weights"):
        assert np.all(getattr(out, name)[[0, 3]] == 7.0), name
    assert out.failed[[0, 3]].all()


def test_where_poses_give_no_covariance_that_of_the_optimum_serves(room):
    _, truth, _ = room
    optima = np.tile(truth, (COUNT, 1))
    out, draws, _ = proposed(
        room, IMPROVED, matches=matches_at(optima), guesses=around(truth, 12), near=np.zeros((POSES, 3))
    )
    assert not out.failed[1:3].any()
    expected = wrapped(optima + np.linalg.solve(FACTOR.T, draws.error.T).T)
    np.testing.assert_allclose(out.pose[1:3], expected[1:3], rtol=1e-12)
    assert len(set(np.sign(wrapped(np.concatenate([optima, expected]))[:, 2]))) == 2  # some heading passed pi


def test_a_scan_match_is_the_optimum_with_the_inverse_of_its_hessian(room):
    grids, truth, hits = room
    optima = around(truth, 13)
    out, *_ = proposed(room, SCAN_MATCH, matches=matches_at(optima), guesses=around(truth, 14))
    for i in (1, 2):
        np.testing.assert_array_equal(out.pose[i], optima[i])
        np.testing.assert_array_equal(out.mean[i], optima[i])
        np.testing.assert_allclose(out.covariance[i], np.linalg.inv(HESSIAN), rtol=1e-9, atol=1e-15)
        assert out.log_gain[i] == pytest.approx(-costs_at(grids, i, optima[i : i + 1], hits)[0], rel=1e-12)
        assert (out.matched[i], out.failed[i]) == (0.5, False)
    assert np.isnan(out.samples[1:3]).all()
    assert np.isnan(out.sample_weights[1:3]).all()


def test_a_single_hit_may_be_matched(room):
    _, truth, hits = room
    optima = around(truth, 18)
    out, *_ = proposed(room, SCAN_MATCH, matches=matches_at(optima), guesses=optima, hits=hits[:1])
    assert not out.failed[1:3].any()


def test_poses_far_from_the_prediction_still_have_weights(room):
    """Products of exp(-1e9) or so, of which the largest still counts as 1."""
    _, truth, _ = room
    optima = around(truth, 19)
    out, *_ = proposed(room, IMPROVED, matches=matches_at(optima), guesses=optima + np.array([2e4, 0.0, 0.0]))
    assert np.all(out.log_gain[1:3] < -1e6)
    np.testing.assert_allclose(out.sample_weights[1:3].sum(axis=1), 1.0)


FAILED = {"share": 0.5 - 1e-9, "share unknown": math.nan}


@pytest.mark.parametrize("kind", [IMPROVED, SCAN_MATCH, MOTION], ids=["improved", "scan match", "motion"])
@pytest.mark.parametrize("why", [*FAILED, "no hits"])
def test_without_a_match_the_sample_of_the_motion_model_weighs_its_likelihood(room, kind, why):
    grids, truth, hits = room
    if why == "no hits":
        hits = hits[:0]
    guesses = around(truth, 15)
    guesses[:, 2] = 0.7
    share = FAILED.get(why, 1.0)
    out, _, sampled = proposed(room, kind, matches=matches_at(guesses, share=share), guesses=guesses, hits=hits)
    turn = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = turn @ np.diag(1.0 / PRECISION[0, :2]) @ turn.T
    covariance[2, 2] = 1.0 / PRECISION[0, 2]
    for i in (1, 2):
        np.testing.assert_array_equal(out.pose[i], sampled[i])
        np.testing.assert_array_equal(out.mean[i], guesses[i])
        np.testing.assert_allclose(out.covariance[i], covariance, rtol=1e-9, atol=1e-18)
        assert out.log_gain[i] == pytest.approx(-costs_at(grids, i, sampled[i : i + 1], hits)[0], rel=1e-12)
        assert out.failed[i] == (kind != MOTION)
    np.testing.assert_array_equal(out.matched[1:3], 0.0 if kind == MOTION else share)
    assert np.isnan(out.samples[1:3]).all()
    assert np.isnan(out.sample_weights[1:3]).all()


def test_only_the_particles_of_a_span_are_drawn_from_the_motion_model():
    guesses, draws, out = variates(16, COUNT, 3), variates(17, COUNT, 3), np.full((COUNT, 3), 7.0)
    component = np.array([0.5, 0.5, 0.1, 0.5])  # the third: odometry has failed
    sample_motions(1, 3, guesses, PRIOR, Draws(draws, draws, draws, component, component), out)
    for i, precision in ((1, PRECISION[0]), (2, PRECISION[1])):
        np.testing.assert_allclose(out[i], se2.compose(guesses[i], draws[i] / np.sqrt(precision)), rtol=1e-12)
    assert np.all(out[[0, 3]] == 7.0)
