# SPDX-License-Identifier: MIT
"""New poses of all particles from one scan: which map, which numbers and which settings each of them gets."""

import numpy as np
import pytest

from slam import se2
from slam.config import FilterConfig, MotionConfig
from slam.config.filter import MapConfig, MatchConfig, ProposalConfig
from slam.matching._gauss_newton_kernels import gauss_newton
from slam.matching._likelihood_kernels import end_points, walls_of
from slam.matching.likelihood import ScanAndPrior, make_beam_model
from slam.matching.proposal import _half_width, next_errors, propose_poses
from slam.matching.scan_matching import make_match_settings
from slam.motion.odometry_model import motion_prior
from slam.sensor.rays import make_rays
from tests.slam.rooms import drive, empty_maps, scan_at

MOTION = (0.3, 0.0, 0.12)
PATH = drive(4)
HITS = np.ascontiguousarray(make_rays([scan_at(PATH[4], beams=61)], usable_range=80.0).ends)
SETTINGS = MatchConfig(beam_weight=0.2)
PRIOR = motion_prior(MOTION, MotionConfig(failure_share=0.0))


def maps_of(count):
    """That many particles' maps of the room, all the same."""
    maps = empty_maps(count, cell=0.05, field_radius=0.4)
    for truth in PATH[:4]:
        maps.integrate_scan(np.tile(truth, (count, 1)), make_rays([scan_at(truth, beams=180)], usable_range=80.0))
    return maps


@pytest.fixture(scope="module")
def room():
    return maps_of(1)


def proposed(maps, guesses, *, hits=HITS, match=SETTINGS, errors=None, rng=None, **proposal):
    config = FilterConfig(match=match, proposal=ProposalConfig(**proposal), map=MapConfig(cell=0.05, field_radius=0.4))
    evidence = ScanAndPrior(hits, make_beam_model(config.match, config.map), PRIOR)
    search, weights = make_match_settings(MOTION, hits, config), np.full(len(guesses), 1.0 / len(guesses))
    rng = np.random.default_rng(5) if rng is None else rng
    return propose_poses(maps, guesses, evidence, search, config, rng, weights=weights, errors=errors)


def guesses_of(count):
    return PATH[4] + np.random.default_rng(1).normal(scale=(0.02, 0.02, 0.01), size=(count, 3))


def optimum_of(maps, guess):
    """The optimum (3,) of the product about a predicted pose, and the Cholesky factor of its Hessian (3, 3)."""
    config = FilterConfig(match=SETTINGS, map=MapConfig(cell=0.05, field_radius=0.4))
    evidence = end_points(HITS), make_beam_model(config.match, config.map), PRIOR
    pose, factor = np.empty(3), np.empty((3, 3))
    gauss_newton(walls_of(maps.grids, 0), guess, guess, evidence, 100, pose, factor)
    return pose, factor


@pytest.mark.parametrize("kind", ["improved", "scan-match", "motion"])
@pytest.mark.parametrize("count", [1, 2])
def test_particles_that_share_a_map_get_what_each_gets_with_a_map_of_its_own(kind, count):
    """Also where the last of them do not fill a whole round of the maps."""
    guesses, errors = guesses_of(5), np.random.default_rng(2).normal(size=(5, 3))
    shared, own = (proposed(maps_of(n), guesses, errors=errors, kind=kind) for n in (count, 5))
    for name, found, expected in zip(own._fields, shared, own, strict=True):
        np.testing.assert_array_equal(found, expected, err_msg=name)


def test_errors_go_on_from_the_last_ones_and_without_them_are_drawn_anew(room):
    guesses, last = guesses_of(6), np.random.default_rng(3).normal(size=(6, 3))
    fresh = proposed(room, guesses).error
    np.testing.assert_array_equal(
        fresh, np.random.default_rng(5).standard_normal((26, 3))[20:], "20 poses first, then the particles' own"
    )
    np.testing.assert_array_equal(proposed(room, guesses, errors=last).error, next_errors(last, fresh, 0.2))


def test_the_new_pose_is_off_the_mean_by_its_error(room):
    errors = np.random.default_rng(4).normal(size=(6, 3))
    out = proposed(room, guesses_of(6), errors=errors)
    expected = out.mean + np.einsum("iab,ib->ia", np.linalg.cholesky(out.covariance), out.error)
    np.testing.assert_allclose(out.pose, expected, atol=1e-12)


def test_scan_match_starts_from_the_sample_of_the_motion_model(room):
    guesses = guesses_of(4)
    samples = proposed(room, guesses, kind="motion").pose
    found = proposed(room, guesses, kind="scan-match").pose
    for i in range(4):
        np.testing.assert_allclose(found[i], optimum_of(room, samples[i])[0], atol=2e-5)
        assert np.abs(found[i] - optimum_of(room, guesses[i])[0]).max() > 2e-4


def test_poses_scatter_by_1_2_times_the_laplace_approximation(room):
    guess = guesses_of(1)
    samples = proposed(room, guess, samples=20_000).samples[0]
    optimum, factor = optimum_of(room, guess[0])
    whitened = (samples - optimum) @ factor / 1.2
    np.testing.assert_allclose(whitened.mean(axis=0), 0.0, atol=0.05)
    np.testing.assert_allclose(np.cov(whitened.T), np.eye(3), atol=0.05)


def test_poses_that_are_drawn_evenly_fill_the_interval_of_the_settings(room):
    width = {"sample_range": 0.02, "sample_range_heading": 0.003}
    out = proposed(room, guesses_of(1), samples=2000, sampling="even", **width)
    spans = np.ptp(out.samples[0], axis=0)
    np.testing.assert_allclose(spans, (0.04, 0.04, 0.006), rtol=0.01)
    assert np.all(spans <= (0.04, 0.04, 0.006))


def test_the_interval_is_for_even_poses_only(room):
    assert _half_width(ProposalConfig()).tolist() == [0.0, 0.0, 0.0]
    narrow, wide = (proposed(room, guesses_of(3), sample_range=width).samples for width in (0.01, 0.5))
    np.testing.assert_array_equal(narrow, wide)


def test_all_settings_draw_as_many_numbers(room):
    """So that a change of one setting changes no other number of a run."""
    following = set()
    for options in (
        {"kind": "improved"},
        {"kind": "motion"},
        {"kind": "scan-match"},
        {"sampling": "even"},
        {"errors": np.zeros((3, 3))},
    ):
        rng = np.random.default_rng(5)
        proposed(room, guesses_of(3), rng=rng, **options)
        following.add(rng.uniform())
    assert len(following) == 1


def test_the_smallest_share_of_matched_hits_is_a_setting(room):
    """Half of the beams end where there is no wall."""
    hits = HITS.copy()
    hits[::2] *= 0.5
    guesses = se2.compose(PATH[4], np.zeros((3, 3)))
    failed = [
        proposed(room, guesses, hits=hits, match=MatchConfig(beam_weight=0.2, min_matched_share=share)).failed
        for share in (0.3, 0.7)
    ]
    assert not failed[0].any()
    assert failed[1].all()
