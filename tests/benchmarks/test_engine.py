# SPDX-License-Identifier: MIT
"""What the filter costs: match, proposal, map update, resampling and the whole step.

    python -m pytest -m benchmark tests/benchmarks/test_engine.py

Each stage runs on a simulated room, against the number of particles, beams and threads, and the whole step also on the
log intel-910 where it is present. `extra_info` of each figure holds microseconds per particle.
"""

import copy
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from slam import FilterConfig, GMapping, se2
from slam.config import GateConfig, ResampleConfig
from slam.matching._scan_matching_kernels import match
from slam.matching.likelihood import ScanAndPrior, make_beam_model
from slam.matching.scan_matching import make_match_settings
from slam.motion.odometry_model import motion_prior
from slam.particles.resampling import systematic
from slam.sensor.rays import make_rays
from tests.slam.rooms import drive, scan_at

pytestmark = pytest.mark.benchmark

ROOT = Path(__file__).resolve().parents[2]
INTEL = Path(os.environ.get("TESTBED_DATASETS", ROOT.parent / "shared" / "datasets")) / "intel" / "intel-910.clf.gz"
EVERY_SCAN = GateConfig(distance=0.0, angle=0.0)
STEP = (0.3, 0.0, 0.12)
SIZES = pytest.mark.parametrize(("particles", "beams"), [(30, 180), (30, 360), (30, 720), (30, 1080), (300, 180)])


class Stage:
    """A filter after some scans of the room, and the scan that comes next."""

    def __init__(self, particles, beams, threads=1, when="always"):
        config = FilterConfig(particles=particles, gate=EVERY_SCAN, resample=ResampleConfig(when=when))
        self.mapper = GMapping(config, threads=threads)
        rng = np.random.default_rng(0)
        path = drive(8)
        for pose in path[:-1]:
            self.mapper.process(pose, scan_at(pose, beams=beams, noise=0.01, rng=rng))
        self.odometry = path
        self.scan = scan_at(path[-1], beams=beams, noise=0.01, rng=rng)
        self.rays = make_rays([self.scan], usable_range=80.0)
        self.guesses = se2.compose(self.mapper.poses, STEP)


def per_particle(benchmark, particles):
    """Note the median in microseconds per particle."""
    benchmark.extra_info["us_per_particle"] = round(1e6 * benchmark.stats.stats.median / particles, 1)


@SIZES
def test_match(benchmark, particles, beams):
    stage = Stage(particles, beams)
    config, grids = stage.mapper.config, stage.mapper.maps.grids
    hits = np.ascontiguousarray(stage.rays.ends[stage.rays.hit])
    evidence = ScanAndPrior(hits, make_beam_model(config.match, config.map), motion_prior(STEP, config.motion))
    search = make_match_settings(np.array(STEP), hits, config)
    pose, L = np.empty(3), np.empty((3, 3))

    def match_all():
        for i in range(particles):
            match(grids, i, stage.guesses[i], evidence, search, pose, L)

    benchmark(match_all)
    per_particle(benchmark, particles)


@SIZES
def test_match_and_sample(benchmark, particles, beams):
    """Lines 4 to 21 of Algorithm 1; less `test_match` it is the cost of the K samples and the Gaussian."""
    stage = Stage(particles, beams)
    proposed = benchmark(stage.mapper._propose, np.array(STEP), stage.rays)
    assert not proposed.failed.any()
    per_particle(benchmark, particles)


@SIZES
def test_map_update(benchmark, particles, beams):
    """Registering one more scan, tiles private already, as where nothing was resampled."""
    stage = Stage(particles, beams, when="never")
    benchmark(stage.mapper.maps.register, stage.guesses, stage.rays)
    per_particle(benchmark, particles)


@pytest.mark.parametrize("particles", [30, 300])
def test_map_update_after_resampling(benchmark, particles):
    """The same where all particles share all tiles, which are copied on the first write."""
    stage = Stage(particles, 180)

    def share():
        stage.mapper.maps = copy.copy(stage.mapper.maps)
        for pool in ("_counts", "_surface", "_field"):
            setattr(stage.mapper.maps, pool, copy.deepcopy(getattr(stage.mapper.maps, pool)))
        stage.mapper.maps.inherit(np.zeros(particles, np.int64))

    benchmark.pedantic(lambda: stage.mapper.maps.integrate_scan(stage.guesses, stage.rays), setup=share, rounds=20)
    per_particle(benchmark, particles)


@pytest.mark.parametrize("particles", [30, 300, 3000])
def test_resample(benchmark, particles):
    """Ancestors, and the tables and trajectories that follow them."""
    stage = Stage(particles, 60)
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(particles))

    def resample():
        ancestors = systematic(weights, rng)
        stage.mapper.maps.inherit(ancestors)
        stage.mapper.ancestry.inherit(ancestors)

    benchmark(resample)
    per_particle(benchmark, particles)


def back_and_forth(stage):
    """The whole step, over and over on the same stretch of the room."""
    turn = [0]

    def step():
        turn[0] += 1
        pose = stage.odometry[-1 - turn[0] % 2]
        return stage.mapper.process(pose, stage.scan if turn[0] % 2 == 0 else stage.before)

    stage.before = scan_at(stage.odometry[-2], beams=len(stage.scan.ranges))
    return step


@SIZES
def test_step(benchmark, particles, beams):
    stage = Stage(particles, beams, when="ess")
    assert benchmark(back_and_forth(stage)).updated
    per_particle(benchmark, particles)


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_step_with_threads(benchmark, threads):
    if threads > len(os.sched_getaffinity(0)):
        pytest.skip(f"this machine has fewer than {threads} cores")
    stage = Stage(100, 360, threads=threads, when="ess")
    assert benchmark(back_and_forth(stage)).updated
    per_particle(benchmark, 100)


needs_intel = pytest.mark.skipif(not INTEL.exists(), reason=f"{INTEL} is absent")


def scans_of(log):
    from testbed.formats import open_log

    return [frame for frame in open_log(log).frames if frame.scan is not None]


def mapped(frames, particles, threads):
    """The filter after all frames, with its last report."""
    mapper = GMapping(FilterConfig(particles=particles), threads=threads)
    for frame in frames:
        report = mapper.process(frame.odometry, frame.scan, twist=frame.twist)
    return mapper, report


@needs_intel
@pytest.mark.parametrize("threads", [1, 2])
def test_intel_log(benchmark, threads):
    """The whole log with 30 particles and the settings as they are; microseconds per update and particle."""
    frames = scans_of(INTEL)
    mapper, report = benchmark.pedantic(mapped, (frames, 30, threads), rounds=3, warmup_rounds=1)
    per_particle(benchmark, 30 * len(mapper.update_scans))
    benchmark.extra_info["updates"] = len(mapper.update_scans)
    benchmark.extra_info["map_bytes_per_particle"] = report.map_bytes // 30
    assert np.all(np.isfinite(mapper.path()))


@needs_intel
def test_second_thread_on_the_intel_log(benchmark):
    """Throughput of two threads over that of one, each run in turn, so that both meet the same machine."""
    frames, seconds = scans_of(INTEL), {1: [], 2: []}

    def both():
        for threads, times in seconds.items():
            start = time.perf_counter()
            mapped(frames, 30, threads)
            times.append(time.perf_counter() - start)

    benchmark.pedantic(both, rounds=3, warmup_rounds=1)
    benchmark.extra_info["throughput_ratio"] = round(min(seconds[1]) / min(seconds[2]), 2)


@needs_intel
def test_memory_of_300_particles_on_the_whole_intel_log(benchmark):
    """Maps per particle at the worst moment and at the end, and the peak of a process of its own, over 4519 scans."""
    log = INTEL.with_name("intel-merged.clf.gz")
    command = [sys.executable, "-m", "tools.measure.memory_of_log", str(log), "--particles", "300"]

    def run():
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout

    benchmark.extra_info.update(json.loads(benchmark.pedantic(run, rounds=1)))
