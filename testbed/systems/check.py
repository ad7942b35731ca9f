# SPDX-License-Identifier: MIT
"""Tries a system on a short drive, on the same drive again, and on the bad input that real recordings hold."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

import worlds
from eval.scoring import Reference, score
from slam import se2
from testbed.frame import Frame
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from testbed.systems.entrant import ClassEntrant
from testbed.systems.errors import SystemFailedError
from testbed.systems.execute import trajectory_at_scans
from testbed.systems.feeding import Estimated

WORLD, SECONDS = "office", 20.0
"""The drive of the check: a tour of this world, for so long [s], without physics."""
CALL_SECONDS = 300.0
"""One call of a method may take so long [s]: the first may compile the system's code."""
MAX_WORSE = 2.0
"""A trajectory error that exceeds the odometry's by this factor hints at a wrong frame or unit."""


@dataclass(frozen=True)
class Finding:
    """One line of the result."""

    level: Literal["ok", "warning", "error"]
    text: str
    """What was tried, and what was found if it was not right."""


def check_system(entrant: ClassEntrant) -> Iterator[Finding]:
    """Try a system and yield what was found, one thing after the other; SystemsError where it cannot be made.

    An error breaks the protocol. A warning is what the protocol allows and what will go wrong on some recordings.
    """
    entrant = dataclasses.replace(entrant, seconds=CALL_SECONDS)
    system = entrant.make()
    yield Finding("ok", f"made: {system.name}, version {system.version}")
    yield _settings(system)
    frames = drive()
    try:
        estimated, cost = entrant.run(frames, seed=0)
    except SystemFailedError as error:
        yield Finding("error", f"a drive of {SECONDS:g} s through {WORLD}: {error}")
        yield Finding("warning", "not tried: the same seed again, and bad input, since the drive itself failed")
        return
    scans = sum(frame.scan is not None for frame in frames)
    posed = len(estimated.at_scans)
    yield Finding("ok", f"a drive of {SECONDS:g} s through {WORLD}: a pose at {posed} of {scans} scans, in their order")
    if len(estimated.at_scans) < 0.9 * scans:
        yield Finding("warning", "fewer than 90 % of the scans have a pose: such a run counts as lost")
    yield from (Finding("warning", note) for note in estimated.notes)
    yield _map(estimated)
    if seen := estimated.particles.by_scan:
        yield Finding("ok", f"particles: at {len(seen)} scans, {max(len(w) for _, w in seen.values())} at most")
    yield _accuracy(frames, estimated)
    yield _deterministic(entrant, frames, estimated)
    for name, change in BAD_INPUT.items():
        yield _survives(entrant, name, change(frames))
    yield Finding("ok", f"cost: {cost.ms_per_scan:.2f} ms a scan" + _memory(cost.memory_mb))


def drive() -> list[Frame]:
    """Return the drive of the check: with the errors of the simulated lidar and wheels, the same at each call."""
    config = SimulationConfig(backend="fast", duration=SECONDS, seeds=RunSeeds.from_seed(0))
    with simulate(worlds.load(WORLD), config) as simulation:
        return list(simulation)


def _memory(megabytes: float | None) -> str:
    return "" if megabytes is None else f", {megabytes:.0f} MB"


def _settings(system: object) -> Finding:
    settings = getattr(system, "settings", None)
    if settings is None:
        return Finding("ok", "settings: none")
    if not dataclasses.is_dataclass(settings) or isinstance(settings, type):
        return Finding("error", f"settings: {type(settings).__name__}, expected a dataclass with defaults, or none")
    return Finding("ok", f"settings: {', '.join(field.name for field in dataclasses.fields(settings))}")


def _map(estimated: Estimated) -> Finding:
    grid = estimated.grid
    if grid is None:
        return Finding("ok", "map: none")
    rows, cols = grid.probability.shape
    return Finding("ok", f"map: {cols} x {rows} cells of {grid.resolution:g} m, {grid.known.mean():.0%} known")


def _accuracy(frames: Sequence[Frame], estimated: Estimated) -> Finding:
    """Compare the error with that of the wheels: a pose in another frame or unit is far worse."""
    truth = trajectory_at_scans(frames, lambda frame: frame.truth)
    odometry = trajectory_at_scans(frames, lambda frame: frame.odometry)
    found = score(estimated.dense[estimated.at_scans], reference=Reference(trajectory=truth), odometry=odometry)
    own, wheels = found["trajectory"]["ate_rmse_m"], found["trajectory"]["odometry"]["ate_rmse_m"]
    words = f"trajectory error {own:.3f} m, the wheels' {wheels:.3f} m"
    if own > MAX_WORSE * wheels:
        return Finding("warning", f"{words}: is it T_map_robot, x forward, y left, metres and radians?")
    return Finding("ok", f"{words} (too short a drive to judge by; a warning from {MAX_WORSE:g} times on)")


def _deterministic(entrant: ClassEntrant, frames: Sequence[Frame], first: Estimated) -> Finding:
    """Run it again with the same seed while the global generators say something else."""
    legacy, standard = np.random.get_state(), random.getstate()  # noqa: NPY002  # what a system may have used
    np.random.seed(12345)  # noqa: NPY002
    random.seed(12345)
    try:
        again, _ = entrant.run(frames, seed=0)
    except SystemFailedError as error:
        return Finding("error", f"a second run with the same seed: {error}")
    finally:
        np.random.set_state(legacy)  # noqa: NPY002
        random.setstate(standard)
    equal = np.array_equal(first.dense.poses, again.dense.poses) and _same_map(first, again)
    expected = "expected the same bits; take all random numbers from the seed of start"
    return Finding("ok", "same seed, same bits") if equal else Finding("error", f"same seed, other result: {expected}")


def _same_map(first: Estimated, second: Estimated) -> bool:
    if first.grid is None or second.grid is None:
        return first.grid is second.grid
    return np.array_equal(first.grid.probability, second.grid.probability, equal_nan=True)


def _survives(entrant: ClassEntrant, name: str, frames: list[Frame]) -> Finding:
    try:
        entrant.run(frames, seed=0)
    except SystemFailedError as error:
        return Finding("warning", f"{name}: {error}")
    return Finding("ok", name)


def _each_scan(frames: Sequence[Frame], change: Callable[[int, Frame], Frame]) -> list[Frame]:
    """The frames, those with a scan changed; `change` gets the number of the scan."""
    changed, number = [], 0
    for frame in frames:
        if frame.scan is None:
            changed.append(frame)
        else:
            changed.append(change(number, frame))
            number += 1
    return changed


def _ranges(value: float) -> Callable[[Sequence[Frame]], list[Frame]]:
    """Let three scans in the middle of ten have no other readings than this."""

    def change(number: int, frame: Frame) -> Frame:
        assert frame.scan is not None
        if number % 10 not in (4, 5, 6):
            return frame
        return replace(frame, scan=replace(frame.scan, ranges=np.full_like(frame.scan.ranges, value)))

    return lambda frames: _each_scan(frames, change)


def _beams(frames: Sequence[Frame]) -> list[Frame]:
    """Every tenth scan has a beam less, and one has none."""

    def change(number: int, frame: Frame) -> Frame:
        assert frame.scan is not None
        count = 0 if number == 15 else -1 if number % 10 == 5 else len(frame.scan.ranges)
        times = None if frame.scan.time_offsets is None else frame.scan.time_offsets[:count]
        scan = replace(
            frame.scan, ranges=frame.scan.ranges[:count], angles=frame.scan.angles[:count], time_offsets=times
        )
        return replace(frame, scan=scan)

    return _each_scan(frames, change)


def _stamps(frames: Sequence[Frame]) -> list[Frame]:
    """Every seventh frame has the stamp of the one before, every eleventh one that lies before it."""
    changed = list(frames)
    for row in range(1, len(frames)):
        if row % 7 == 0 or row % 11 == 0:
            stamp = changed[row - 1].stamp - (0.02 if row % 11 == 0 else 0.0)
            scan = changed[row].scan
            scan = scan if scan is None else replace(scan, stamp=stamp)
            changed[row] = replace(changed[row], stamp=stamp, scan=scan)
    return changed


def _restart(frames: Sequence[Frame]) -> list[Frame]:
    """The odometry begins anew at its origin half way."""
    half = len(frames) // 2
    origin = frames[half].odometry
    later = [replace(frame, odometry=se2.between(origin, frame.odometry)) for frame in frames[half:]]
    return [*frames[:half], *later]


def _askew(frames: Sequence[Frame]) -> list[Frame]:
    """A second lidar that looks backward takes every other scan."""

    def change(number: int, frame: Frame) -> Frame:
        assert frame.scan is not None
        if number % 2 == 0:
            return frame
        scan = replace(frame.scan, angles=frame.scan.angles - np.pi, mount=_turned(frame.scan.mount))
        return replace(frame, scan=scan, lidar="second")

    return _each_scan(frames, change)


def _turned(mount: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, theta = mount
    return x, y, theta + np.pi


def _without_odometry(frames: Sequence[Frame]) -> list[Frame]:
    """Only the frames with a scan, as many recorders keep them."""
    return [replace(frame, twist=None) for frame in frames if frame.scan is not None]


BAD_INPUT: dict[str, Callable[[Sequence[Frame]], list[Frame]]] = {
    "scans without any return (inf)": _ranges(np.inf),
    "scans without any valid reading (NaN)": _ranges(np.nan),
    "scans with other numbers of beams, one with none": _beams,
    "stamps that repeat and step back": _stamps,
    "odometry that starts again": _restart,
    "two lidars, one looking backward": _askew,
    "no frames between the scans, no twist": _without_odometry,
}
"""What recordings of real robots hold, by the words of the check."""
