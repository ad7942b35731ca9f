# SPDX-License-Identifier: MIT
"""The compiled filter beside the reference, on the same scans and the same random numbers."""

from dataclasses import replace

import numpy as np
import pytest

from slam import FilterConfig, GMapping, se2
from slam.config import GateConfig, MapConfig, MatchConfig, MotionConfig, ProposalConfig, ResampleConfig
from slam.sensor.rays import make_rays
from tests.slam.reference_filter import ReferenceFilter
from tests.slam.rooms import counts_of, drive, scan_at

STEPS = 4
MOTION = MotionConfig(
    translation_from_translation=0.1,
    translation_from_rotation=0.05,
    rotation_from_translation=0.1,
    rotation_from_rotation=0.1,
    floor_translation=0.005,
    floor_rotation=0.003,
    failure_share=0.05,
    failure_along=1.0,
    failure_limit=0.4,
    failure_rotation=0.3,
    jump_share=0.0,  # without jumps there is no wide search: see tests/slam/matching/test_wide_search.py
)
MATCH = MatchConfig(
    hit_sigma=0.05,
    beam_weight=0.3,
    outlier_distance=0.3,
    min_matched_share=0.1,
    search_reach=0.8,
    search_step=0.1,
    coarse_share=0.3,
    coarse_beams=15,
    weight_share=0.5,
    iterations=20,
)


def config_of(kind, when="ess", **match):
    return FilterConfig(
        particles=3,
        motion=MOTION,
        map=MapConfig(cell=0.1, field_radius=0.4, wall_share=0.25),
        match=replace(MATCH, **match),
        proposal=ProposalConfig(kind=kind, samples=20),
        resample=ResampleConfig(when=when, threshold=0.7, scheme="systematic"),
        gate=GateConfig(distance=0.0, angle=0.0),
    )


def recording(seed, passers_by):
    """Odometry and scans with noise; that share of the readings is cut short by somebody passing by."""
    rng = np.random.default_rng(seed)
    truth = drive(STEPS)
    odometry = np.zeros_like(truth)
    for k, motion in enumerate(se2.between(truth[:-1], truth[1:])):
        odometry[k + 1] = se2.compose(odometry[k], motion + rng.normal(scale=(0.03, 0.02, 0.02)))
    scans = [scan_at(pose, beams=45, noise=0.01, rng=rng) for pose in truth]
    for scan in scans[1:]:
        scan.ranges[rng.random(45) < passers_by] *= 0.5
    return odometry, scans


def assert_close(found, expected, *, typical, most):
    """A bound on the median deviation, and one on the largest: an end point at the border of a cell, or at the middle
    between two walls, may fall to either side."""
    deviation = np.abs(np.asarray(found) - np.asarray(expected))
    assert np.median(deviation) < typical
    assert deviation.max() < most


def in_step(config, seed, passers_by=0.0):
    """Both filters after each scan of one recording."""
    odometry, scans = recording(seed, passers_by)
    fast, slow = GMapping(config, seed=seed, threads=1), ReferenceFilter(config, seed)
    fast.process(odometry[0], scans[0])
    slow.begin(make_rays([scans[0]], usable_range=80.0))
    for k in range(1, len(scans)):
        report = fast.process(odometry[k], scans[k])
        motion = se2.between(odometry[k - 1], odometry[k])
        log_gains, ess, resampled = slow.update(motion, make_rays([scans[k]], usable_range=80.0))
        assert_close(report.proposed.log_gain, log_gains, typical=0.01, most=0.5)
        assert report.ess == pytest.approx(ess, abs=0.1)
        assert report.resampled == resampled
        poses = np.array([particle.pose for particle in slow.particles])
        assert_close(se2.between(fast.poses, poses), 0.0, typical=1e-4, most=3e-3)
        assert_close(fast.weights, slow.weights, typical=0.005, most=0.06)
        yield fast, slow, report


@pytest.mark.parametrize("kind", ["improved", "scan-match", "motion"])
@pytest.mark.parametrize(("when", "seed"), [("always", 1), ("never", 3), ("ess", 5)])
def test_poses_weights_paths_and_maps_agree(kind, when, seed):
    steps = list(in_step(config_of(kind, when), seed))
    fast, slow, _ = steps[-1]
    paths = [np.array(particle.path) for particle in slow.particles]
    assert_close([fast.path(i) for i in range(3)], paths, typical=1e-4, most=3e-3)
    for i, particle in enumerate(slow.particles):
        hits, visits, walls = counts_of(fast.maps, i)
        column, row = fast.maps.grids.corner
        places = [(y - row, x - column) for x, y in particle.map.cells]
        same = [
            (hits[place], visits[place], walls[place]) == (cell.hits, cell.visits, cell.wall)
            for place, cell in zip(places, particle.map.cells.values(), strict=True)
        ]
        assert np.mean(same) > 0.97
        assert abs(int((visits > 0).sum()) - len(places)) < 0.01 * len(places)


def test_where_matching_fails_they_agree_too():
    steps = in_step(config_of("improved", min_matched_share=0.75), 3, passers_by=0.3)
    failures = [report.match_failures for _, _, report in steps]
    assert 0 < sum(failures) < 3 * STEPS
