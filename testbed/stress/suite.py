# SPDX-License-Identifier: MIT
"""The stress suite: perturbations of several severities, spread over worlds, robots and seeds; every pair occurs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbed.frame import Frame
from testbed.seeds import RunSeeds
from testbed.stress.table import perturb

ROBOTS = (("create3", "rplidar_a2"), ("pioneer3dx", "lms200"), ("burger", "lds01"), ("dingo_d", "ust10lx"))
"""Robots with their lidars."""
WORLDS = (
    "office", "maze", "warehouse", "nested_loops", "campus", "park",
    "generated:rooms:size=30x20:7101", "generated:cave:size=30x20:7102",
)  # fmt: skip
"""Six worlds of the catalogue, two of them large, and two that are drawn by seeds of their own."""
SEVERITIES = ("mild", "middle", "severe")
VALUES = {
    "spin": (20.0, 45.0, 80.0),
    "push": (0.5, 1.0, 2.0),
    "stuck-odometry": (1.0, 3.0, 8.0),
    "backward-odometry": (1.0, 3.0, 8.0),
    "scan-gap": (1.0, 3.0, 8.0),
    "restart-odometry": (1.0, 2.0, 6.0),
    "scan-period": (0.5, 1.0, 2.0),
    "reach": (8.0, 5.0, 3.5),
}
"""Values of the suite's perturbations (`testbed.stress.table`): mild, middle, severe."""
PERTURBATIONS = tuple(VALUES)


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
    """The frames of a drive under a perturbation of one of `SEVERITIES`. None of them draws random numbers."""
    return perturb(frames, {perturbation: VALUES[perturbation][severity]}, RunSeeds.from_seed(0).perturbation)
