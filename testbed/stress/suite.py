# SPDX-License-Identifier: MIT
"""The stress suite: perturbations of several severities, spread over worlds, robots and seeds; every pair occurs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from testbed.frame import Frame
from testbed.stress import perturbations

ROBOTS = (("create3", "rplidar_a2"), ("pioneer3dx", "lms200"), ("burger", "lds01"), ("dingo_d", "ust10lx"))
"""Robots with their lidars."""
WORLDS = (
    "office", "maze", "warehouse", "nested_loops",
    "generated:rooms:size=30x20:7101", "generated:cave:size=30x20:7102",
    "generated:corridors:size=40x30:7103", "generated:blocks:size=60x40:7104",
)  # fmt: skip
"""Four worlds of the catalogue, and four that are drawn by seeds of their own, two of them large."""
SEVERITIES = ("mild", "middle", "severe")
PERIOD = 20.0
"""Faults that last for a moment are repeated after this time [s]."""

Fault = Callable[[Iterable[Frame], float], Iterator[Frame]]


def _each(fault: Callable[..., Iterator[Frame]], **values: Sequence[object]) -> tuple[Fault, ...]:
    """The fault with one value of a parameter for each severity."""
    ((name, given),) = values.items()
    return tuple(partial(fault, **{name: value}) for value in given)


TURNS = [np.array([0.1, 0.0, np.radians(degrees)]) for degrees in (20.0, 45.0, 80.0)]
"""What wheels report that spin on the spot [m, m, rad]."""
MOMENTARY: dict[str, tuple[Fault, ...]] = {
    "slip on the spot": _each(perturbations.slip, motion=TURNS),
    "push": _each(perturbations.carry, seconds=(0.5, 1.0, 2.0)),
    "odometry stands still": _each(perturbations.stop_odometry, seconds=(1.0, 3.0, 8.0)),
    "odometry counts backward": _each(perturbations.reverse_odometry, seconds=(1.0, 3.0, 8.0)),
    "scans lost": _each(perturbations.lose_scans, seconds=(1.0, 3.0, 8.0)),
}
"""Faults of a moment, repeated each `PERIOD`: mild, middle, severe."""
RESTARTS = (60.0, 30.0, 10.0)
"""Time between two starts of the odometry's driver [s]."""
LASTING: dict[str, tuple[Callable[[Iterable[Frame]], Iterator[Frame]], ...]] = {
    "few scans": tuple(partial(perturbations.thin_scans, seconds=s) for s in (0.5, 1.0, 2.0)),
    "short range": tuple(partial(perturbations.limit_range, metres=m) for m in (8.0, 5.0, 3.5)),
}
"""Faults that last for the whole drive."""
PERTURBATIONS = (*MOMENTARY, "odometry starts again", *LASTING)


@dataclass(frozen=True)
class Case:
    """One run of the suite."""

    world: str
    robot: str
    lidar: str
    perturbation: str
    severity: int
    """0 to 2, see `SEVERITIES`."""
    seed: int

    @property
    def name(self) -> str:
        """A name fit for a file."""
        words = (self.world, self.robot, self.perturbation, SEVERITIES[self.severity], str(self.seed))
        return "-".join(words).replace(" ", "_").replace(":", "_").replace("=", "_")


def design(runs: int) -> list[Case]:
    """The first cases of a fractional design; 600 of them hold every pair of factors many times.

    Each block holds every perturbation at every severity once; worlds and robots are dealt out anew in each block,
    evenly and at random from a fixed seed (a random balanced design). The seed of a drive counts the blocks.
    """
    rng = np.random.default_rng(21)
    kinds = [(name, severity) for name in PERTURBATIONS for severity in range(len(SEVERITIES))]
    cases: list[Case] = []
    for block in range(-(-runs // len(kinds))):
        places = rng.permutation(np.resize(np.arange(len(WORLDS)), len(kinds)))
        robots = rng.permutation(np.resize(np.arange(len(ROBOTS)), len(kinds)))
        for (name, severity), place, robot in zip(kinds, places, robots, strict=True):
            cases.append(Case(WORLDS[place], *ROBOTS[robot], name, severity, 7000 + block))
    return cases[:runs]


def perturbed(frames: list[Frame], perturbation: str, severity: int) -> list[Frame]:
    """The frames of a drive under a perturbation of one of `SEVERITIES`."""
    out: Iterable[Frame] = frames
    last = frames[-1].stamp
    if perturbation in LASTING:
        return list(LASTING[perturbation][severity](out))
    if perturbation in MOMENTARY:
        for at in np.arange(PERIOD, last, PERIOD):
            out = MOMENTARY[perturbation][severity](out, float(at))
    else:
        for at in np.arange(RESTARTS[severity], last, RESTARTS[severity]):
            out = perturbations.restart_odometry(out, float(at))
    return list(out)
