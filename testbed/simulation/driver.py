# SPDX-License-Identifier: MIT
"""Who steers the robot: what the simulator asks of a driver, and the one that follows the world's tour.

The tour's driver steers by the true pose, as a person with a joystick would: what is driven then does not depend on
the estimator. Source: R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset


@dataclass(frozen=True, kw_only=True)
class DriverConfig:
    """Who drives, and how; the robot's own limits apply besides."""

    kind: Literal["tour", "explore", "recorded", "teleop"] = "tour"
    """tour: along the tour of the world; explore: to the borders of what is mapped; recorded: the commands of
    --commands; teleop: by keyboard, in real time."""
    speed: float = 0.45
    """Cruising speed [m/s]."""
    turn_rate: float = 1.0
    """Fastest turn [rad/s]."""
    acceleration: float = 0.5
    """[m/s²]; harder braking makes the simulated body pitch."""
    turn_acceleration: float = 3.0
    """[rad/s²]."""
    lookahead: float = 0.4
    """Distance of the point on the path that the robot steers to [m]."""
    turn_on_spot_above: float = 0.9
    """With the point farther to the side than this the robot turns without driving [rad]."""
    patience: float = 5.0
    """Without progress for so long the robot counts as stuck and backs off [s]."""
    max_recoveries: int = 5
    """After so many tries to back off the drive is given up."""

    def __post_init__(self) -> None:
        for name in ("speed", "turn_rate", "acceleration", "turn_acceleration", "lookahead", "patience"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


class Driver(Protocol):
    """Asked for a command once in every control period."""

    @property
    def finished(self) -> bool:
        """The drive has come to its end as planned."""
        ...

    @property
    def stuck(self) -> bool:
        """The drive is given up."""
        ...

    @property
    def share(self) -> float | None:
        """Share of the drive that is behind the robot, 0 to 1; None where nobody knows its end."""
        ...

    @property
    def recoveries(self) -> int:
        """How often the robot had to free itself."""
        ...

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s] for the robot that truly is at this pose at this time [s]."""
        ...

    def wait(self, stamp: float) -> tuple[float, float]:
        """The command where someone stands in the robot's way: 0, 0. Time spent so does not count as being stuck."""
        ...


_PROGRESS = 0.05
"""Motion along the path that counts as progress [m]."""
_TURN_PROGRESS = 0.2
"""Turning that counts as progress [rad]."""
_BACK_OFF = (-0.1, 2.0)
"""Speed [m/s] and time [s] of backing off."""
_ARRIVED = 0.05
"""Distance to the end of the path at which the tour is finished [m]."""


class TourDriver:
    """Follows a polyline to its end, slows down in bends, turns on the spot at sharp corners, backs off if stuck."""

    def __init__(self, path: NDArray[np.float64], robot: RobotPreset, config: DriverConfig) -> None:
        """path: corners (n, 2) [m], world frame. Raises `ValueError` if it has fewer than two different corners."""
        corners = [(float(x), float(y)) for x, y in path]
        corners = corners[:1] + [b for a, b in pairwise(corners) if a != b]
        if len(corners) < 2:
            raise ValueError("a tour needs at least one way point besides the start")
        self._corners = corners
        self._lengths = [math.dist(a, b) for a, b in pairwise(corners)]
        self._starts = [0.0, *np.cumsum(self._lengths).tolist()]
        self._config = config
        self._speed, self._turn_rate = min(config.speed, robot.max_speed), min(config.turn_rate, robot.max_turn_rate)
        self._along = 0.0
        self._last_progress = (0.0, 0.0, 0.0)  # time, along, heading
        self._backing_until = -math.inf
        self._recoveries = 0

    @property
    def length(self) -> float:
        """Length of the whole path [m]."""
        return float(self._starts[-1])

    @property
    def share(self) -> float:
        """Share of the path that is behind the robot, 0 to 1."""
        return self._along / self.length

    @property
    def finished(self) -> bool:
        """The end of the path is reached."""
        return self.length - self._along < _ARRIVED

    @property
    def stuck(self) -> bool:
        """Backing off did not help."""
        return self._recoveries > self._config.max_recoveries

    @property
    def recoveries(self) -> int:
        """How often the robot had to back off."""
        return self._recoveries

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s] for the robot at this pose and time [s]."""
        self._advance(x, y)
        if self.finished:
            return 0.0, 0.0
        if stamp < self._backing_until:
            return _BACK_OFF[0], 0.0
        if self._no_progress(stamp, theta):
            self._recoveries += 1
            self._backing_until = stamp + _BACK_OFF[1]
            self._last_progress = (self._backing_until, self._along, theta)
            return _BACK_OFF[0], 0.0
        goal_x, goal_y = self._point(self._along + self._config.lookahead)
        distance = math.hypot(goal_x - x, goal_y - y)
        bearing = _wrapped(math.atan2(goal_y - y, goal_x - x) - theta)
        return self._pursue(distance, bearing)

    def wait(self, stamp: float) -> tuple[float, float]:
        """The command to stand still, with the reason elsewhere: time [s] spent so does not count as being stuck."""
        self._last_progress = (stamp, *self._last_progress[1:])
        return 0.0, 0.0

    def _pursue(self, distance: float, bearing: float) -> tuple[float, float]:
        if abs(bearing) > self._config.turn_on_spot_above:
            return 0.0, math.copysign(min(self._turn_rate, 2.0 * abs(bearing)), bearing)
        braking = math.sqrt(2.0 * self._config.acceleration * max(self.length - self._along, 0.5 * _ARRIVED))
        speed = min(self._speed, braking) * math.cos(bearing)
        curvature = 2.0 * math.sin(bearing) / max(distance, 0.5 * self._config.lookahead)
        if abs(curvature) * speed > self._turn_rate:
            speed = self._turn_rate / abs(curvature)
        return speed, curvature * speed

    def _no_progress(self, stamp: float, theta: float) -> bool:
        since, along, heading = self._last_progress
        if self._along - along > _PROGRESS or abs(_wrapped(theta - heading)) > _TURN_PROGRESS:
            self._last_progress = (stamp, self._along, theta)
            return False
        return stamp - since > self._config.patience

    def _advance(self, x: float, y: float) -> None:
        """Move on to the point of the path nearest to the robot, no farther than twice the lookahead from the last."""
        low, high = self._along, self._along + 2.0 * self._config.lookahead
        best, best_along = math.inf, low
        for k in range(self._leg(low), self._leg(high) + 1):
            begin, length = self._starts[k], self._lengths[k]
            (ax, ay), (bx, by) = self._corners[k], self._corners[k + 1]
            t = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length
            t = min(max(t, low - begin, 0.0), high - begin, length)
            px, py = ax + (bx - ax) * t / length, ay + (by - ay) * t / length
            away = math.hypot(x - px, y - py)
            if away < best - 1e-9:
                best, best_along = away, begin + t
        self._along = best_along

    def _leg(self, along: float) -> int:
        """Number of the leg that holds the point at that distance from the beginning of the path."""
        return min(bisect_right(self._starts, along) - 1, len(self._lengths) - 1)

    def _point(self, along: float) -> tuple[float, float]:
        """The point of the path at that distance from its beginning, or its end."""
        k = self._leg(along)
        t = min((along - self._starts[k]) / self._lengths[k], 1.0)
        (ax, ay), (bx, by) = self._corners[k], self._corners[k + 1]
        return ax + t * (bx - ax), ay + t * (by - ay)


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
