# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure what an update of the filter costs per particle, by place and stage, with one thread and with two.

    python -m tools.measure.engine_cost [--places intel,fr079,office,acapulco] [--rounds 3] [--scans 400]

Prints: the figures of docs/filter.md (what it costs), beside those of the C++ GMapping on such a machine

Microseconds of CPU time with one thread; shares of the stages in it; how many times as fast two threads are, by the
wall clock; memory of the maps per particle. The runs take turns, so that they meet the same machine; the best round
counts. `office` is simulated. The logs are read from $TESTBED_DATASETS, by default ../shared/datasets.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import worlds
from slam import FilterConfig, GMapping
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.simulation import SimulationConfig, simulate
from tools.pages import DOCS

DATASETS = Path(os.environ.get("TESTBED_DATASETS", DOCS.parents[1] / "shared" / "datasets"))
LOGS = {
    "intel": "intel/intel-910.clf.gz",
    "fr079": "fr079/fr079-merged.clf.gz",
    "acapulco": "acapulco/acapulco-merged.clf.gz",
}
CPP_US = {"intel": 4000, "fr079": 6700}
"""Microseconds per update and particle of the C++ GMapping on such a machine."""
STAGES = ("match", "map", "resample")


@dataclass(frozen=True)
class Cost:
    """What one run costs."""

    updates: int
    """Scans that the filter used."""
    beams: int
    """Readings of a scan."""
    us: float
    """CPU time per update and particle [us]."""
    wall: float
    """Wall time of the run [s]."""
    stages: dict[str, float]
    """Share of the wall time of each stage that `StepReport.seconds` names."""
    map_mb: float
    """Memory of the maps at the end, per particle [MB = 1e6 bytes]."""


def frames_of(place: str, scans: int) -> list[Frame]:
    """The first scans of a log or a simulated drive."""
    if place in LOGS:
        return [frame for frame in open_log(DATASETS / LOGS[place]).frames if frame.scan is not None][:scans]
    with simulate(worlds.load(place), SimulationConfig(backend="fast")) as simulation:
        return list(islice((frame for frame in simulation if frame.scan is not None), scans))


def cost_of(frames: Sequence[Frame], particles: int, threads: int) -> Cost:
    """What the filter costs on these frames."""
    mapper, seconds = GMapping(FilterConfig(particles=particles), threads=threads), dict.fromkeys(STAGES, 0.0)
    start, cpu = time.perf_counter(), time.process_time()
    for frame in frames:
        assert frame.scan is not None
        report = mapper.process(frame.odometry, frame.scan, twist=frame.twist)
        for stage in STAGES:
            seconds[stage] += report.seconds.get(stage, 0.0)
    cpu, wall, updates = time.process_time() - cpu, time.perf_counter() - start, len(mapper.update_scans)
    shares = {stage: seconds[stage] / wall for stage in STAGES}
    us = 1e6 * cpu / (updates * particles)
    return Cost(updates, sum(report.readings), us, wall, shares, report.map_bytes / particles / 1e6)


def row(place: str, one: Cost, two: Cost) -> str:
    """The line of a place in the table."""
    stages = " | ".join(f"{one.stages[stage]:.0%}" for stage in STAGES)
    anchor = f"{CPP_US[place]}, {CPP_US[place] / one.us:.0f} times" if place in CPP_US else ""
    figures = f"{one.us:.0f} | {stages} | {1.0 - sum(one.stages.values()):.0%} | {one.wall / two.wall:.2f}"
    return f"| {place} | {one.beams} | {one.updates} | {figures} | {one.map_mb:.2f} | {anchor} |"


def main() -> None:
    """Measure the places and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--places", default="intel,fr079,office,acapulco")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scans", type=int, default=400)
    parser.add_argument("--particles", type=int, default=30)
    args = parser.parse_args()
    print("| place | beams | updates | us | match | map | resample | rest | two threads | MB | C++ |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for place in args.places.split(","):
        frames = frames_of(place, args.scans)
        cost_of(frames, 5, 1)  # all kernels are loaded
        rounds = [[cost_of(frames, args.particles, threads) for threads in (1, 2)] for _ in range(args.rounds)]
        one, two = (min(costs, key=lambda cost: cost.wall) for costs in zip(*rounds, strict=True))
        print(row(place, one, two), flush=True)


if __name__ == "__main__":
    main()
