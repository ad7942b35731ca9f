# SPDX-License-Identifier: MIT
"""Commands that drive a robot along a path at the times of the recording.

A tracking controller (Y. Kanayama et al., A stable tracking control method for an autonomous mobile robot, ICRA 1990)
drives the simulator's vehicle along the smoothed path once; the commands that it gave are kept. Since the vehicle of
the backend `fast` moves exactly as commanded, they drive the same way every time, whatever the odometry says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slam import se2
from slam.se2 import Pose
from testbed.presets import RobotPreset
from testbed.simulation.config import CONTROL_PERIOD, CONTROL_STEPS
from testbed.simulation.drivers.driver import Command
from testbed.simulation.physics.backend import AccelerationLimits
from testbed.simulation.physics.fast import FastBackend
from worlds import World

SMOOTHING = 0.5
"""Standard deviation of the window that smooths the path over time [s]."""
MAX_AWAY = 0.15
"""A robot farther from the path than this heads for it, whatever its heading there should be [m]."""
_AHEAD, _ACROSS, _TURN = 2.0, 15.0, 3.0
"""Gains of the errors ahead [1/s], across [1/m²] and of the heading [1/s]."""
_LEAD = 0.2
"""Distance of the point ahead of the axle that is steered back to the path [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Route:
    """Commands that follow a path, and what they did."""

    commands: list[Command]
    """One for each control period."""
    driven: Pose
    """Poses at the times of the commands, and at the end, (m + 1, 3)."""
    away: NDArray[np.float64]
    """Distance from the smoothed path at these times [m], (m + 1,)."""
    contacts: int
    """Control periods in which the robot touched a wall."""


def follow(
    world: World, robot: RobotPreset, limits: AccelerationLimits, stamps: NDArray[np.float64], path: Pose
) -> Route:
    """Drive a robot from the world's start along a path and keep the commands.

    stamps (n,): increasing [s]; path (n, 3): `T_world_robot` at these times
    """
    wanted = _smoothed(stamps, path)
    velocities = se2.between(wanted[:-1], wanted[1:]) / CONTROL_PERIOD
    backend = FastBackend(world, robot, limits)
    pose = backend.drive(0.0, 0.0, 1).poses[-1]
    commands, driven, contacts = [], [pose], 0
    for k, velocity in enumerate(velocities):
        speed, turn_rate = _tracking(se2.between(pose, wanted[k]), velocity)
        speed = min(max(speed, -robot.max_speed), robot.max_speed)
        turn_rate = min(max(turn_rate, -robot.max_turn_rate), robot.max_turn_rate)
        commands.append(Command(k * CONTROL_PERIOD, speed, turn_rate))
        motion = backend.drive(speed, turn_rate, CONTROL_STEPS)
        contacts += motion.contact
        pose = motion.poses[-1]
        driven.append(pose)
    backend.close()
    poses = np.array(driven)
    return Route(commands=commands, driven=poses, away=np.hypot(*(poses - wanted)[:, :2].T), contacts=contacts)


def _tracking(error: Pose, velocity: Pose) -> tuple[float, float]:
    """Return speed [m/s] and turn rate [rad/s] for a robot that sees its place on the path at `error` (3,), where the
    path moves with `velocity` (3,) in its own frame.

    Far from the path a point `_LEAD` ahead of the axle, or behind it on the way back, is steered: it can move sideways.
    """
    ahead, across, turn = error.tolist()
    speed, _, turn_rate = velocity.tolist()
    if math.hypot(ahead, across) < MAX_AWAY:
        forward = speed * math.cos(turn) + _AHEAD * ahead
        return forward, turn_rate + _ACROSS * speed * across + _TURN * math.sin(turn)
    lead = _LEAD if speed >= 0.0 else -_LEAD
    forward = speed * math.cos(turn) + _AHEAD * (ahead + lead * (math.cos(turn) - 1.0))
    return forward, (speed * math.sin(turn) + _AHEAD * (across + lead * math.sin(turn))) / lead


def fastest(stamps: NDArray[np.float64], path: Pose) -> tuple[float, float]:
    """Return the largest speed [m/s] and turn rate [rad/s] on the smoothed path."""
    poses = _smoothed(stamps, path)
    velocities = se2.between(poses[:-1], poses[1:]) / CONTROL_PERIOD
    return float(np.abs(velocities[:, 0]).max()), float(np.abs(velocities[:, 2]).max())


def _smoothed(stamps: NDArray[np.float64], path: Pose) -> Pose:
    """Return the path at the times of commands, from its beginning, smoothed, headings unwrapped, (m, 3)."""
    times = np.arange(stamps[0], stamps[-1] + CONTROL_PERIOD, CONTROL_PERIOD)
    columns = [path[:, 0], path[:, 1], np.unwrap(path[:, 2])]
    window = SMOOTHING / CONTROL_PERIOD
    smooth = [ndimage.gaussian_filter1d(np.interp(times, stamps, part), window, mode="nearest") for part in columns]
    return np.stack(smooth, axis=1)
