# SPDX-License-Identifier: MIT
"""Rough surfaces look the same from the same place, other from elsewhere; their statistics are those asked for."""

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.random import SeedSequence

from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, OdometryConfig, SimulationConfig, SurfaceConfig, simulate
from testbed.simulation.physics.backend import Hits
from testbed.simulation.robot._surface_kernels import sum_waves
from testbed.simulation.robot.surface import LENGTHS, Surface
from worlds import load

N = 4000
ROUGH = SurfaceConfig(roughness=0.02)


def beams(places, directions):
    """Beams of 3 m that end at places (n, 2) from directions (n,): hits, origins, directions."""
    headings = np.stack([np.cos(directions), np.sin(directions)], axis=1)
    return Hits(np.full(len(places), 3.0), np.ones(len(places))), places - 3.0 * headings, directions


def off(config, places, directions, *, seed=0, lidar=0, surface=None):
    """How much farther the beams seem to go (n,) [m]."""
    surface = surface or Surface(config, 2, SeedSequence(seed))
    return surface.over(*beams(places, directions), lidar).distances - 3.0


@pytest.fixture
def places():
    return np.random.default_rng(5).uniform(0.0, 200.0, (N, 2))


def test_a_smooth_surface_changes_nothing(places):
    hits, origins, directions = beams(places, np.zeros(N))
    assert Surface(SurfaceConfig(scatter=0.1), 1, SeedSequence(0)).over(hits, origins, directions, 0) is hits
    assert SimulationConfig().surface == SurfaceConfig()


def test_its_size_is_the_one_asked_for(places):
    """Over 20 fields, since places of one field share its waves."""
    values = np.stack([off(ROUGH, places, np.zeros(N), seed=seed) for seed in range(20)])
    assert values.std() == pytest.approx(0.02, rel=0.03)
    assert abs(values.mean()) < 5 * 0.02 / math.sqrt(20 * N)


def correlation(places, shift, turn):
    """Correlation of what two beams see whose ends are `shift` [m] and whose directions `turn` [rad] apart."""
    pairs = []
    for seed in range(20):
        surface = Surface(ROUGH, 1, SeedSequence(seed))
        one = off(ROUGH, places, np.zeros(N), surface=surface)
        pairs.append(one * off(ROUGH, places + np.array([0.0, shift]), np.full(N, turn), surface=surface))
    return np.mean(pairs) / 0.02**2


def test_it_is_alike_near_by_and_from_nearly_the_same_view(places):
    """The mean over lengths l of exp(-d^2 / 2 l^2), lengths even on a logarithmic scale; Gaussian in the direction."""
    lengths = np.geomspace(*LENGTHS, 1000)
    for shift in (0.0, 0.03, 0.2, 1.0):
        expected = np.mean(np.exp(-(shift**2) / (2.0 * lengths**2)))
        assert correlation(places, shift, 0.0) == pytest.approx(expected, abs=0.05)
    for turn in (6.0, 12.0, 24.0):
        expected = math.exp(-((turn / 12.0) ** 2) / 2.0)
        assert correlation(places, 0.0, math.radians(turn)) == pytest.approx(expected, abs=0.05)
    assert abs(correlation(places, 0.0, math.radians(90.0))) < 0.03


def test_all_lidars_see_the_same_at_any_time_and_scatter_on_their_own(places):
    scattered = SurfaceConfig(roughness=0.02, scatter=0.05, scatter_share=0.3)
    surface = Surface(ROUGH, 2, SeedSequence(1))
    seen = [off(ROUGH, places, np.zeros(N), lidar=k, surface=surface) for k in (0, 1, 0)]
    assert all(np.array_equal(one, other) for one, other in pairwise(seen))
    surface = Surface(scattered, 2, SeedSequence(1))
    own = [off(scattered, places, np.zeros(N), lidar=k, surface=surface) - seen[0] for k in (0, 1, 0)]
    fresh = Surface(scattered, 2, SeedSequence(1))
    alone = off(scattered, places, np.zeros(N), lidar=1, surface=fresh) - seen[0]
    assert np.array_equal(alone, own[1])  # whatever the other lidar has seen
    for part in own:
        moved = np.abs(part) > 1e-12
        assert moved.mean() == pytest.approx(0.3, abs=0.03)
        assert part[moved].std() == pytest.approx(0.05, rel=0.1)
    assert abs(np.corrcoef(own)[np.triu_indices(3, 1)]).max() < 0.06


def test_beams_that_meet_nothing_meet_nothing():
    hits, origins, directions = beams(np.zeros((3, 2)), np.zeros(3))
    hits.distances[1] = math.inf
    found = Surface(ROUGH, 1, SeedSequence(0)).over(hits, origins, directions, 0).distances
    assert np.isfinite(found).tolist() == [True, False, True]
    hits.distances[:] = 1e-4
    assert (
        Surface(SurfaceConfig(scatter=1.0, scatter_share=1.0), 1, SeedSequence(0))
        .over(hits, origins, directions, 0)
        .distances.min()
        >= 0.0
    )


def scans_of(surface, **changes):
    config = SimulationConfig(
        robot=load_robot("create3"),
        lidar=load_lidar("rplidar_a2"),
        backend="fast",
        duration=6.0,
        odometry=OdometryConfig(),
        lidar_layers=LidarLayers.none(),
        surface=surface,
        seeds=RunSeeds.from_seed(3),
        **changes,
    )
    with simulate(load("apartment"), config) as simulation:
        stepped = [frame.scan.ranges for frame in simulation if frame.scan is not None]
    with simulate(load("apartment"), config) as simulation:
        frames = [frame for block in simulation.blocks(64) for frame in block.frames()]
        blocks = [frame.scan.ranges for frame in frames if frame.scan is not None]
    return stepped, blocks


def test_the_waves_are_cosines(places):
    """The slow reference: every wave at the end of every beam by the library's cosine."""
    rng = np.random.default_rng(0)
    waves, phases = rng.normal(size=(7, 4)), rng.uniform(size=7)
    hits, origins, directions = beams(places[:50], rng.uniform(0.0, 7.0, 50))
    headings = np.stack([np.cos(directions), np.sin(directions)], axis=1)
    arguments = np.concatenate([places[:50], headings], axis=1) @ waves.T + phases
    expected = np.cos(2.0 * math.pi * arguments).sum(axis=1)
    assert sum_waves(hits.distances, origins, directions, waves, phases) == pytest.approx(expected, abs=1e-3)


def test_blocks_and_steps_agree_to_the_bit():
    rough, blocks = scans_of(SurfaceConfig(roughness=0.02, scatter=0.05, scatter_share=0.2))
    smooth, _ = scans_of(SurfaceConfig())
    assert len(rough) == len(blocks) > 20
    assert all(np.array_equal(a, b) for a, b in zip(rough, blocks, strict=True))
    seen = np.isfinite(smooth) & np.isfinite(rough)
    assert np.std((np.array(rough) - smooth)[seen]) == pytest.approx(math.sqrt(0.02**2 + 0.2 * 0.05**2), rel=0.3)


@pytest.mark.parametrize(
    "wrong", [{"roughness": -0.1}, {"scatter": math.nan}, {"view_deg": 0.0}, {"scatter_share": 1.5}]
)
def test_impossible_sizes_are_refused(wrong):
    (name,) = wrong
    with pytest.raises(ValueError, match=f"surface.{name} must be"):
        SurfaceConfig(**wrong)
