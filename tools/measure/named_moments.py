# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Count how often the moment and the cause of a failure are named.

    python -m tools.measure.named_moments [--times 20 30 45] [--worlds office,generated:rooms:7]

Prints: one line for each run, then a table of the kinds of fault

Each kind of fault is put into a simulated drive of each world at known times. Runs that end lost, or with a broken
loop, are counted: the moment is named if it lies within 2 s of the fault, or within 1 m of it along the true path.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np
from scipy.stats import binomtest

import worlds
from eval.failure_cause import find_cause
from eval.first_failure import find_failure
from slam.config import FilterConfig
from testbed.frame import Frame
from testbed.run.estimation import Estimation
from testbed.simulation import OdometryConfig, SimulationConfig, simulate
from testbed.stress import perturbations

WORLDS = ("office", "maze", "apartment", "warehouse", "loop")
DURATION = 80.0
NEAR_S, NEAR_M = 2.0, 1.0
TURN = np.array([0.0, 0.0, np.radians(150.0)])
Fault = Callable[[Iterable[Frame], float], Iterator[Frame]]
FAULTS: dict[str, tuple[Fault, float, str]] = {
    "slip": (partial(perturbations.slip, motion=TURN), 0.5, "slipped"),
    "push": (partial(perturbations.carry, seconds=4.0), 0.0, "pushed or carried"),
    "carried away": (partial(perturbations.carry, seconds=20.0), 0.0, "pushed or carried"),
    "lidar blind": (partial(perturbations.blind, seconds=20.0), 20.0, "next to nothing"),
    "scans lost": (partial(perturbations.lose_scans, seconds=20.0), 20.0, "no scan came"),
    "odometry restarted": (perturbations.restart_odometry, 0.0, "restarted"),
}
"""The fault, how long it lasts [s], and a part of the sentence that names it."""


def drive(world: str) -> list[Frame]:
    """The frames of a drive with worn wheels."""
    frames = []
    config = SimulationConfig(backend="fast", odometry=OdometryConfig(grade="poor"))
    with simulate(worlds.load(world), config) as simulation:
        for frame in simulation:
            if frame.stamp > DURATION:
                break
            frames.append(frame)
    return frames


def judge(frames: list[Frame], fault: str, at: float) -> tuple[bool, bool, bool, str]:
    """Whether the run failed, its moment and its cause were named, and what was found."""
    inject, lasts, words = FAULTS[fault]
    estimation = Estimation(FilterConfig(particles=3), seed=0, threads=1)
    for frame in inject(frames, at):
        estimation.process(frame)
    truth, odometry = (estimation.trajectory_at_scans(name) for name in ("truth", "odometry"))
    steps = estimation.steps.columns()
    estimate = estimation.filtered().at_scans
    failure = find_failure(estimate, truth=truth)
    if failure is None or not failure.bad or truth is None:
        return False, False, False, "did not fail"
    cause = find_cause(failure.stamp, odometry=odometry, reference=truth, steps=steps, estimate=estimate) or ""
    path = np.interp([at, at + lasts, failure.stamp], truth.stamps, truth.distance)
    late = max(at - failure.stamp, failure.stamp - at - lasts, 0.0)
    far = max(path[0] - path[2], path[2] - path[1], 0.0)
    named = late <= NEAR_S or far <= NEAR_M
    return True, named, words in cause, f"{failure.stamp - at:+.1f} s; {cause}"


def main() -> None:
    """Print one line for each run, then the counts of each kind of fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=float, nargs="+", default=[20.0, 30.0, 45.0], help="when faults happen [s]")
    parser.add_argument("--worlds", default=",".join(WORLDS), help="names of worlds, as `testbed sweep` takes them")
    arguments = parser.parse_args()
    times = arguments.times
    counts: dict[str, list[tuple[bool, bool]]] = defaultdict(list)
    for world in worlds.expand_names(arguments.worlds):
        frames = drive(world)
        for fault in FAULTS:
            for at in times:
                failed, named, explained, found = judge(frames, fault, at)
                if failed:
                    counts[fault].append((named, explained))
                print(
                    f"{world}, {fault} at {at:g} s: {'' if named or not failed else 'NOT NAMED, '}{found}", flush=True
                )
    print("\n| fault | failed runs | moment named | cause named |\n|---|---|---|---|")
    everything = [row for found in counts.values() for row in found]
    for fault, rows in [*counts.items(), ("all", everything)]:
        named, explained = (sum(row[k] for row in rows) for k in (0, 1))
        low, high = binomtest(named, len(rows)).proportion_ci(method="wilson")
        print(f"| {fault} | {len(rows)} | {named} ({low:.0%} to {high:.0%}) | {explained} |")


if __name__ == "__main__":
    main()
