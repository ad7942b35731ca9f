# SPDX-License-Identifier: MIT
"""Same settings, seed and input: the same bits, whatever runs them."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slam import FilterConfig, GMapping, se2
from slam.config import AdaptConfig, GateConfig, MapConfig, MatchConfig, ProposalConfig, ResampleConfig
from tests.slam.rooms import drive, scan_at

ROOT = Path(__file__).parents[2]


def config(kind="improved", count="fixed"):
    return FilterConfig(
        particles=7,
        map=MapConfig(cell=0.05, field_radius=0.4),
        match=MatchConfig(weight_share=0.5),
        proposal=ProposalConfig(kind=kind),
        adapt=AdaptConfig(count=count, min_particles=3, max_particles=20, position=0.05, heading=0.05, error=1.0),
        resample=ResampleConfig(when="ess", threshold=0.6),
        gate=GateConfig(distance=0.1, angle=0.1),
    )


def recording(steps=12):
    """Odometry (steps + 1, 3) and scans, both with noise; twice the robot does not move on."""
    rng = np.random.default_rng(11)
    truth = drive(steps)
    truth[4], truth[5] = truth[3], truth[3]
    noise = rng.normal(scale=(0.02, 0.01, 0.02), size=truth.shape)
    return se2.compose(truth, noise), [scan_at(pose, beams=90, noise=0.01, rng=rng) for pose in truth]


def mapped(kind="improved", seed=3, threads=1, count="fixed"):
    mapper = GMapping(config(kind, count), seed=seed, threads=threads)
    odometry, scans = recording()
    for pose, scan in zip(odometry, scans, strict=True):
        mapper.process(pose, scan)
    return mapper


def digest(mapper):
    """Hash over the paths and maps of all particles and their weights."""
    content = hashlib.sha256(mapper.weights.tobytes())
    for particle in range(len(mapper.poses)):
        grid = mapper.map(particle)
        content.update(mapper.path(particle).tobytes())
        content.update(grid.probability.tobytes())
        content.update(repr(grid.origin).encode())
    return content.hexdigest()


@pytest.mark.parametrize(
    ("kind", "count"), [("improved", "fixed"), ("improved", "kld"), ("scan-match", "fixed"), ("motion", "fixed")]
)
def test_any_number_of_threads(kind, count):
    digests = {digest(mapped(kind, threads=threads, count=count)) for threads in (1, 2, 3, 16)}
    assert len(digests) == 1


def test_another_process():
    code = "from tests.slam.test_reproducibility import digest, mapped; print(digest(mapped(threads=2)))"
    other = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert other.stdout.strip() == digest(mapped())


def test_another_seed_gives_another_result():
    assert digest(mapped(seed=3)) != digest(mapped(seed=4))


def test_the_generator_of_numpy_is_left_alone():
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first = digest(mapped())
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.random.seed(2)  # noqa: NPY002
    assert digest(mapped()) == first
