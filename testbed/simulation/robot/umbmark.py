# SPDX-License-Identifier: MIT
"""UMBmark: odometry error of a robot after a square of 4 m, driven in both directions.

Source: J. Borenstein and L. Feng, UMBmark: A Method for Measuring, Comparing, and Correcting Dead-reckoning Errors in
Mobile Robots, University of Michigan UM-MEAM-94-22. Here the robot drives exact squares, so that the error is that of
the odometry alone.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.seeds import RunSeeds, children
from testbed.simulation.robot.odometry import Odometry, OdometryConfig

SIDE = 4.0
"""Side of the square [m]."""
_PERIOD = 0.05
"""Time between two odometry readings [s]."""
_SPEED, _TURN_RATE = 0.2, 0.4
"""Slow motion, as the method requires: speed [m/s] and turn rate [rad/s]."""


class UmbmarkResult(NamedTuple):
    """Odometry errors of one robot at the end of its squares."""

    clockwise: NDArray[np.float64]
    """`(x, y)` [m] at the end of each clockwise run, (runs, 2)."""
    counter_clockwise: NDArray[np.float64]
    """`(x, y)` [m] at the end of each counter-clockwise run, (runs, 2)."""

    @property
    def return_error(self) -> float:
        """Root mean square distance from the start over all runs [m]."""
        ends = np.concatenate([self.clockwise, self.counter_clockwise])
        return float(np.sqrt((ends**2).sum(axis=1).mean()))


def umbmark(
    robot: RobotPreset, grade: Literal["good", "typical", "poor"] = "typical", *, seeds: RunSeeds, runs: int = 20
) -> UmbmarkResult:
    """Drive the square `runs` times in each direction, each time with newly drawn systematic errors."""
    config = OdometryConfig(grade=grade)
    ends: dict[int, list[NDArray[np.float64]]] = {-1: [], 1: []}
    for run, child in enumerate(children(seeds.odometry, 2 * runs)):
        direction = 1 if run % 2 else -1
        odometry = Odometry(robot, config, np.random.default_rng(child))
        for left, right in _square(robot, direction):
            odometry.advance(left, right)
        ends[direction].append(odometry.pose[:2])
    return UmbmarkResult(np.array(ends[-1]), np.array(ends[1]))


def _square(robot: RobotPreset, direction: int) -> NDArray[np.float64]:
    """Return the angles of both wheels [rad], (readings, 2), along four sides and four turns on the spot."""
    straight = round(SIDE / _SPEED / _PERIOD)
    turning = round(0.5 * math.pi / _TURN_RATE / _PERIOD)
    side = np.full((straight, 2), SIDE / straight)
    half = direction * 0.25 * math.pi * robot.track / turning
    turn = np.tile([-half, half], (turning, 1))
    return np.cumsum(np.tile(np.concatenate([side, turn]), (4, 1)), axis=0) / robot.wheel_radius
