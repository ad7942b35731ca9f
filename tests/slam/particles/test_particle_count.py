# SPDX-License-Identifier: MIT
"""A particle count that follows the belief: the rule by itself, and a filter whose count changes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam import FilterConfig, GMapping, se2
from slam.config import AdaptConfig, GateConfig, ResampleConfig
from slam.particles.kld import particles_needed
from slam.particles.particle_count import bins_covered, next_count
from slam.sensor.rays import make_rays
from tests.slam.grid.test_tile_pool import assert_accounts_balance
from tests.slam.rooms import drive, empty_maps, scan_at

KLD = AdaptConfig(count="kld")
FINE = AdaptConfig(
    count="kld", min_particles=3, max_particles=20, position=0.05, heading=0.05, error=1.0, resize_factor=1.1
)
"""Bins so small that the belief within one room covers more or fewer of them from scan to scan."""
DEVIATIONS = st.tuples(*[st.floats(0.0, 10.0)] * 3)


def covariance_of(deviations, turn=0.0):
    """Covariance (3, 3) with these deviations along axes that are turned by `turn` in the plane."""
    cos, sin = np.cos(turn), np.sin(turn)
    axes = np.array([(cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)])
    return axes @ np.diag(np.square(deviations)) @ axes.T


@pytest.mark.parametrize(
    ("deviations", "bins"),
    [
        ((0.0, 0.0, 0.0), 1.0),
        ((0.07, 0.07, 0.02), 1.0),  # less than a bin in every direction
        ((0.3, 0.0, 0.0), 4.0),  # two deviations to both sides
        ((0.3, 0.6, 0.0), 32.0),
        ((0.3, 0.0, 0.05), 8.0),
    ],
)
def test_bins_of_a_gaussian(deviations, bins):
    assert bins_covered(covariance_of(deviations), 0.3, 0.1) == pytest.approx(bins)


@given(DEVIATIONS, st.floats(-4.0, 4.0))
def test_how_the_map_is_turned_changes_no_bin(deviations, turn):
    still, turned = (bins_covered(covariance_of(deviations, angle), 0.3, 0.1) for angle in (0.0, turn))
    assert turned == pytest.approx(still, rel=1e-5)


@pytest.mark.parametrize("bins", [2, 3, 5, 10, 20, 50])
def test_the_default_bound_leaves_a_bin_empty_in_one_of_twenty_cases_at_most(bins):
    needed = np.ceil(particles_needed(bins, error=KLD.error, quantile=KLD.quantile))
    assert (1.0 - 1.0 / bins) ** needed < 0.05


@given(st.integers(1, 500), DEVIATIONS)
def test_a_fixed_count_stays(present, deviations):
    assert next_count(present, covariance_of(deviations), AdaptConfig(min_particles=3, max_particles=5)) == present


@given(st.integers(1, 500), DEVIATIONS, st.integers(1, 40), st.integers(0, 100), st.floats(1.0, 3.0))
def test_the_count_stays_or_changes_by_the_factor_to_one_within_bounds(present, deviations, least, more, change):
    config = replace(KLD, min_particles=least, max_particles=least + more, resize_factor=change)
    count = next_count(present, covariance_of(deviations), config)
    if count != present:
        assert least <= count <= least + more
        assert max(count, present) >= change * min(count, present)
    assert next_count(count, covariance_of(deviations), config) == count


def test_a_wide_belief_asks_for_the_most_and_a_narrow_one_for_the_fewest():
    assert next_count(30, covariance_of((5.0, 5.0, 0.5)), KLD) == KLD.max_particles
    assert next_count(30, covariance_of((0.01, 0.01, 0.01)), KLD) == KLD.min_particles


def test_a_count_that_adapts_needs_resampling_and_bounds_in_order():
    with pytest.raises(ValueError, match="only adapt where particles are resampled"):
        FilterConfig(adapt=KLD, resample=ResampleConfig(when="never"))
    with pytest.raises(ValueError, match=r"AdaptConfig\.max_particles must be at least 10"):
        AdaptConfig(max_particles=9)


def config(adapt, **changes):
    return FilterConfig(particles=7, adapt=adapt, gate=GateConfig(distance=0.1, angle=0.1), **changes)


def mapped(settings, steps=14):
    """The filter at each step, with its report and the rays that it drew."""
    rng = np.random.default_rng(11)
    truth = drive(steps)
    odometry = se2.compose(truth, rng.normal(scale=(0.02, 0.01, 0.02), size=truth.shape))
    mapper = GMapping(settings, seed=3, threads=1)
    for pose, measured in zip(truth, odometry, strict=True):
        scan = scan_at(pose, beams=90, noise=0.01, rng=rng)
        rays = make_rays([scan], usable_range=settings.map.usable_range, free_range=0.0, twist=None)
        yield mapper, mapper.process(measured, scan), rays


@pytest.mark.parametrize("scheme", ["systematic", "stratified", "residual", "multinomial"])
def test_poses_weights_paths_and_maps_follow_the_count(scheme):
    counts, drawn = [], []
    for mapper, report, rays in mapped(config(FINE, resample=ResampleConfig(scheme=scheme))):
        n = len(mapper.poses)
        counts.append(n)
        drawn.append(rays)
        assert FINE.min_particles <= n <= FINE.max_particles
        assert report.resampled or n == report.particles
        assert len(report.proposed.pose if report.proposed else mapper.poses) == report.particles
        assert mapper.weights.shape == (n,)
        assert mapper.covariance.shape == (3, 3)
        np.testing.assert_array_equal([mapper.path(i)[-1] for i in range(n)], mapper.poses)
        for pool in mapper.maps._pools:
            assert len(pool.table) == n
            assert_accounts_balance(pool)
    assert np.any(np.diff(counts) > 0)
    assert np.any(np.diff(counts) < 0)
    for particle in range(counts[-1]):  # each map is the one that the particle's own path draws
        alone = empty_maps(1)
        for pose, rays in zip(mapper.path(particle), drawn, strict=True):
            alone.integrate_scan(pose[None], rays)
        np.testing.assert_array_equal(mapper.map(particle).probability, alone.occupancy(0).probability)


def test_a_fixed_count_knows_nothing_of_the_other_settings():
    runs = [list(mapped(config(adapt)))[-1][0] for adapt in (AdaptConfig(), replace(FINE, count="fixed"))]
    assert runs[0].poses.tobytes() == runs[1].poses.tobytes()
    assert len(runs[0].poses) == 7


def test_the_first_scan_finds_the_fewest_particles():
    reports = [report for _, report, _ in mapped(config(FINE))]
    assert reports[0].particles == FINE.min_particles
    assert config(FINE).max_particles == FINE.max_particles
    assert config(AdaptConfig()).max_particles == 7
