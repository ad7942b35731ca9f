# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Count how often the moment and the cause of a failure are named.

    python -m tools.measure.named_moments [--times 20 30 45] [--worlds office,generated:rooms:7] [--faults slip push]

Prints: one line for each run, then a table of the kinds of fault

Each kind of fault is put into a simulated drive of each world at known times. Runs that end lost, or with a broken
loop, are counted: the moment is named if it lies within 2 s of the fault, or within 1 m of it along the true path. A
loop is left open by a filter that follows its wheels, which drift slowly on the way on which the robot returns to a
place: its time is that of the first such return after each time that is given.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import worlds
from eval.failure_cause import find_cause
from eval.first_failure import find_failure
from slam.config import FilterConfig, MotionConfig, ProposalConfig
from testbed.estimation.estimation import Estimation
from testbed.frame import Frame
from testbed.simulation import OdometryConfig, SimulationConfig, simulate
from testbed.stress import perturbations
from tools.measure.stress import share

WORLDS = ("office", "maze", "apartment", "warehouse", "loop")
DURATION, LOOP_DURATION = 80.0, 160.0
"""Longest drives [s], of all faults and of loops that are left open."""
DRIFT_DEG_PER_M, LOOP_M, RETURN_M = 1.6, 10.0, 1.0
"""The wheels report so much turning a metre [deg], over a distance [m], before the robot is within another distance of
a place where it was at least so much driving before."""
NEAR_S, NEAR_M = 2.0, 1.0
OPEN_LOOP = "loop left open"
RESTART_S = 1.2
"""A driver of the wheels that starts again says nothing for so long [s]."""
TURN = np.array([0.0, 0.0, np.radians(150.0)])
FAULTLESS = FilterConfig(particles=3, motion=MotionConfig(failure_share=0.0, jump_share=0.0))
"""A filter whose motion model knows no faults: the usual one survives slips, pushes and restarts."""
TRUSTING = FilterConfig(
    particles=3,
    proposal=ProposalConfig(kind="motion"),
    motion=MotionConfig(
        translation_from_translation=1e-4,
        translation_from_rotation=1e-4,
        rotation_from_translation=1e-4,
        rotation_from_rotation=1e-4,
        floor_translation=1e-5,
        floor_rotation=1e-5,
        failure_share=0.0,
        jump_share=0.0,
    ),
)
"""A filter that follows the wheels: it leaves open what they do not close."""
Fault = Callable[[Iterable[Frame], float], Iterator[Frame]]


def see_again(frames: Iterable[Frame], at: float, *, seconds: float, ago: float) -> Iterator[Frame]:
    """Let the lidar see, for some seconds from a time [s] on, what it saw so many seconds before: two places that look
    the same, of which the filter may take one for the other."""
    frames = list(frames)
    before = [frame for frame in frames if frame.scan is not None and at - ago <= frame.stamp < at]
    for frame in frames:
        if frame.scan is None or not before or not at <= frame.stamp < at + seconds:
            yield frame
            continue
        seen = min(before, key=lambda earlier: abs(earlier.stamp - frame.stamp + ago)).scan
        assert seen is not None
        yield replace(frame, scan=replace(seen, stamp=frame.scan.stamp))


def restart(frames: Iterable[Frame], at: float) -> Iterator[Frame]:
    """Let the driver of the wheels start again at a time [s]: it stands still for a while, then counts from zero."""
    return perturbations.restart_odometry(perturbations.stop_odometry(frames, at, RESTART_S), at + RESTART_S)


def leave_open(frames: Iterable[Frame], end: float) -> Iterator[Frame]:
    """Let the wheels drift on the way on which the robot returns to a place at a time [s]."""
    frames = list(frames)
    stamps, path = np.array([frame.stamp for frame in frames]), path_of(frames)
    begin = float(np.interp(np.interp(end, stamps, path) - LOOP_M, path + 1e-9 * np.arange(len(path)), stamps))
    turn = np.array([0.0, 0.0, np.radians(DRIFT_DEG_PER_M * LOOP_M)])
    yield from perturbations.slip(frames, begin, turn, end - begin)


def path_of(frames: list[Frame]) -> NDArray[np.float64]:
    """The way that the robot has driven at each frame [m], (frames,)."""
    places = np.array([frame.truth for frame in frames])[:, :2]
    return np.r_[0.0, np.cumsum(np.hypot(*np.diff(places, axis=0).T))]


def time_of_return(frames: list[Frame], at: float) -> float | None:
    """When the robot first comes back to an old place after a time [s], over `LOOP_M` of new ones; None = never."""
    stamps, path = np.array([frame.stamp for frame in frames]), path_of(frames)
    places = np.array([frame.truth for frame in frames])[:, :2]
    new = 0.0  # driven since the robot was last at an old place [m]
    for row in range(1, len(path)):
        old = places[path <= path[row] - LOOP_M]
        if not (np.hypot(*(old - places[row]).T) <= RETURN_M).any():
            new += path[row] - path[row - 1]
            continue
        if new >= LOOP_M and stamps[row] > at:
            return float(stamps[row])
        new = 0.0
    return None


FAULTS: dict[str, tuple[Fault, float, str]] = {
    "slip": (partial(perturbations.slip, motion=TURN), 0.5, "slipped"),
    "push": (partial(perturbations.carry, seconds=4.0), 0.0, "pushed or carried"),
    "carried away": (partial(perturbations.carry, seconds=20.0), 0.0, "pushed or carried"),
    "lidar blind": (partial(perturbations.blind, seconds=20.0), 20.0, "next to nothing"),
    "scans lost": (partial(perturbations.lose_scans, seconds=20.0), 20.0, "no scan came"),
    OPEN_LOOP: (leave_open, 0.0, "left open"),
    "odometry restarted": (restart, RESTART_S, "restarted"),
    "wrong loop": (partial(see_again, seconds=8.0, ago=10.0), 8.0, "wrong place"),
}
"""The fault, how long it lasts [s], and a part of the sentence that names it."""


@cache
def drive(world: str, grade: Literal["good", "poor"], duration: float) -> list[Frame]:
    """The frames of a drive with wheels of a grade, of at most so long [s]."""
    frames = []
    config = SimulationConfig(backend="fast", odometry=OdometryConfig(grade=grade))
    with simulate(worlds.load(world), config) as simulation:
        for frame in simulation:
            if frame.stamp > duration:
                break
            frames.append(frame)
    return frames


def judge(frames: list[Frame], fault: str, at: float) -> tuple[bool, bool, bool, str]:
    """Whether the run failed, its moment and its cause were named, and what was found."""
    inject, lasts, words = FAULTS[fault]
    estimation = Estimation(TRUSTING if fault == OPEN_LOOP else FAULTLESS, seed=0, threads=1)
    for frame in inject(frames, at):
        estimation.process(frame)
    truth, odometry = (estimation.trajectory_at_scans(name) for name in ("truth", "odometry"))
    steps = estimation.steps.columns()
    estimate = estimation.filtered().at_scans
    failure = find_failure(estimate, truth=truth, steps=steps)
    if failure is None or not failure.bad or truth is None:
        return False, False, False, "did not fail"
    cause = find_cause(failure.stamp, odometry=odometry, reference=truth, steps=steps, estimate=estimate) or ""
    path = np.interp([at, at + lasts, failure.stamp], truth.stamps, truth.distance)
    late = max(at - failure.stamp, failure.stamp - at - lasts, 0.0)
    far = max(path[0] - path[2], path[2] - path[1], 0.0)
    named = late <= NEAR_S or far <= NEAR_M
    return True, named, words in cause, f"{failure.stamp - at:+.1f} s; {cause}"


def drives(world: str, faults: list[str], times: list[float]) -> Iterator[tuple[list[Frame], str, float]]:
    """The frames of each run in a world, with the fault and when it happens [s]."""
    for fault in faults:
        if fault == OPEN_LOOP:
            frames = drive(world, "good", LOOP_DURATION)
            returns = {time_of_return(frames, at) for at in times} - {None}
            yield from ((frames, fault, at) for at in sorted(at for at in returns if at is not None))
        else:
            frames = drive(world, "poor", DURATION)
            yield from ((frames, fault, at) for at in times)


def main() -> None:
    """Print one line for each run, then the counts of each kind of fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=float, nargs="+", default=[20.0, 30.0, 45.0], help="when faults happen [s]")
    parser.add_argument("--worlds", default=",".join(WORLDS), help="names of worlds, as `testbed sweep` takes them")
    parser.add_argument("--faults", nargs="+", choices=list(FAULTS), default=list(FAULTS), help="kinds of faults")
    arguments = parser.parse_args()
    counts: dict[str, list[tuple[bool, bool]]] = defaultdict(list)
    for world in worlds.expand_names(arguments.worlds):
        for frames, fault, at in drives(world, arguments.faults, arguments.times):
            failed, named, explained, found = judge(frames, fault, at)
            if failed:
                counts[fault].append((named, explained))
            print(f"{world}, {fault} at {at:g} s: {'' if named or not failed else 'NOT NAMED, '}{found}", flush=True)
    print("\n| fault | failed runs | moment named | cause named |\n|---|---|---|---|")
    everything = [row for found in counts.values() for row in found]
    for fault, rows in [*counts.items(), ("all", everything)]:
        named, explained = (sum(row[k] for row in rows) for k in (0, 1))
        print(f"| {fault} | {len(rows)} | {share(named, len(rows))} | {explained} |")


if __name__ == "__main__":
    main()
