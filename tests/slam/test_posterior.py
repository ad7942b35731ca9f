# SPDX-License-Identifier: MIT
"""Two proposals, one posterior: plain sampling of the motion model is a check of the improved proposal."""

import numpy as np
import pytest

from slam import FilterConfig, GMapping, se2
from slam.config import GateConfig, MapConfig, MatchConfig, MotionConfig, ProposalConfig, ResampleConfig
from tests.slam.rooms import drive, scan_at

SEEDS = 8
STEPS = 3


def posterior(kind, particles, seed, failure_share):
    """Mean (3,) and variance (3,) of the last pose, and the log-likelihood of all scans."""
    config = FilterConfig(
        particles=particles,
        motion=MotionConfig(failure_share=failure_share, failure_limit=0.2),
        map=MapConfig(cell=0.1, field_radius=0.4),
        # beams that count in full: with a smaller share the poses of neighbouring scans are not drawn independently
        match=MatchConfig(hit_sigma=0.05 * 10.0**0.5, beam_weight=1.0, outlier_distance=0.3, weight_share=1.0),
        proposal=ProposalConfig(kind=kind, samples=60),
        resample=ResampleConfig(when="ess", threshold=0.5),
        gate=GateConfig(distance=0.0, angle=0.0),
    )
    rng = np.random.default_rng(5)  # one recording for all
    truth = drive(STEPS)
    odometry = np.zeros_like(truth)
    for k, motion in enumerate(se2.between(truth[:-1], truth[1:])):
        odometry[k + 1] = se2.compose(odometry[k], motion + rng.normal(scale=(0.03, 0.02, 0.02)))
    scans = [scan_at(pose, beams=60, noise=0.02, rng=rng) for pose in truth]
    mapper = GMapping(config, seed=seed, threads=2)
    evidence = 0.0
    for pose, scan in zip(odometry, scans, strict=True):
        evidence += mapper.process(pose, scan).log_evidence
    away = se2.between(truth[-1], mapper.poses)
    mean = mapper.weights @ away
    return mean, mapper.weights @ (away - mean) ** 2, evidence


@pytest.mark.parametrize("failure_share", [0.0, pytest.param(0.1, marks=pytest.mark.slow)])
def test_improved_and_motion_proposals_agree_on_the_posterior(failure_share):
    """Means to a quarter of the posterior's own spread, spreads to a third, the evidence to 0.3 nats."""
    results = {
        kind: [posterior(kind, particles, seed, failure_share) for seed in range(SEEDS)]
        for kind, particles in (("improved", 100), ("motion", 500))
    }
    means, variances, evidences = (
        {kind: np.array([run[part] for run in runs]) for kind, runs in results.items()} for part in range(3)
    )
    spread = np.sqrt(variances["motion"].mean(axis=0))
    standard_error = np.sqrt(sum(np.var(m, axis=0, ddof=1) / SEEDS for m in means.values()))
    assert np.all(standard_error < 0.15 * spread)  # fine enough to tell
    difference = means["improved"].mean(axis=0) - means["motion"].mean(axis=0)
    assert np.all(np.abs(difference) < 0.25 * spread)
    ratio = np.sqrt(variances["improved"].mean(axis=0)) / spread
    assert np.all((ratio > 0.75) & (ratio < 1.33))
    assert np.mean(evidences["improved"]) == pytest.approx(np.mean(evidences["motion"]), abs=0.3)


def test_the_improved_proposal_needs_fewer_particles():
    """The reason for it (T-RO 2007, section III): its weights vary less."""

    def effective_share(kind):
        config = FilterConfig(
            particles=200,
            motion=MotionConfig(failure_share=0.0),
            match=MatchConfig(hit_sigma=0.05, beam_weight=0.3, weight_share=1.0),
            proposal=ProposalConfig(kind=kind),
            gate=GateConfig(distance=0.0, angle=0.0),
        )
        mapper = GMapping(config, seed=1, threads=2)
        truth = drive(1)
        return [mapper.process(pose, scan_at(pose, beams=90)).ess / 200 for pose in truth][-1]

    assert effective_share("motion") < 0.3
    assert effective_share("improved") > 0.9
