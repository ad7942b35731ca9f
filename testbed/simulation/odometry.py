# SPDX-License-Identifier: MIT
"""Odometry from wheel encoders, with the errors that real wheels make.

In a well-built simulated robot slip is next to nothing, so the errors are added here: a systematic part, drawn once a
run (wheel radius, track: Borenstein and Feng, UMBmark, 1996), and a random part whose variance grows with the distance
driven and the angle turned, so that it does not depend on how often odometry is computed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from slam.se2 import Pose
from testbed.presets import RobotPreset


class _Grade(NamedTuple):
    """Standard deviations of the systematic errors of a run."""

    distance: float
    rotation: float


GRADES = {"good": _Grade(0.005, 0.01), "typical": _Grade(0.02, 0.03), "poor": _Grade(0.05, 0.10)}
"""Shares of distance and rotation. Ours, after mvsim's N(1, 0.02) forward and N(1, 0.03) in yaw for `typical`."""
_UNEQUAL_WHEELS = 0.03
"""Difference of the two wheels' radii, as a share of the distance error (ours): wheels of one kind are more alike than
their nominal radius is true. With `typical` and a track of 0.23 m it bends a straight line by 0.15 degrees a metre."""


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """How well the wheels tell where the robot went; every layer can be switched off alone."""

    grade: Literal["good", "typical", "poor"] = "typical"
    """Size of the systematic errors."""
    systematic: bool = True
    """Wrong wheel radii and track, drawn once a run."""
    random: bool = True
    """Errors that grow with the root of distance and rotation."""
    ticks: bool = True
    """Encoders count whole ticks."""
    random_translation: float = 0.01
    """Random error along the path [m/sqrt(m)]."""
    random_rotation: float = math.radians(0.5)
    """Random error of heading [rad/sqrt(m)] and [rad/sqrt(rad)]."""
    slip_rate: float = 0.0
    """Slip events per metre driven [1/m]: one wheel spins ahead."""
    slip_distance: float = 0.03
    """Mean distance that a slipping wheel spins ahead [m]."""
    lost_ticks: float = 0.0
    """Share of the wheel's motion that the encoders miss [1]."""

    def __post_init__(self) -> None:
        if self.grade not in GRADES:
            raise ValueError(f"grade must be one of {', '.join(GRADES)}, got {self.grade!r}")
        for name in ("random_translation", "random_rotation", "slip_rate", "slip_distance"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if not 0.0 <= self.lost_ticks < 1.0:
            raise ValueError(f"lost_ticks must be a share in [0, 1), got {self.lost_ticks}")


class Odometry:
    """Integrates wheel angles to a pose `T_odom_robot`, which begins at zero.

    It draws equally many random numbers whatever layers are on, so that switching one leaves the others' noise alone.
    """

    def __init__(self, robot: RobotPreset, config: OdometryConfig, rng: Generator) -> None:
        self._config, self._rng = config, rng
        distance, rotation, unequal = rng.standard_normal(3)
        grade = GRADES[config.grade]
        scale = 1.0 if config.systematic else 0.0
        size = 1.0 + scale * grade.distance * distance
        half_difference = scale * 0.5 * _UNEQUAL_WHEELS * grade.distance * unequal
        self._left_radius = robot.wheel_radius * size * (1.0 - half_difference)
        self._right_radius = robot.wheel_radius * size * (1.0 + half_difference)
        self._track = robot.track * size / (1.0 + scale * grade.rotation * rotation)
        self._nominal_radius, self._nominal_track = robot.wheel_radius, robot.track
        self._tick = 2.0 * math.pi / robot.ticks_per_turn
        self._true_wheels = (0.0, 0.0)
        self._spun = [0.0, 0.0]  # by the wheels, slip included [rad]
        self._counted = [0.0, 0.0]  # by the encoders [rad]
        self._x = self._y = self._theta = 0.0

    @property
    def pose(self) -> Pose:
        """`T_odom_robot`, (3,); the heading is not wrapped."""
        return np.array([self._x, self._y, self._theta])

    def advance(self, left: float, right: float) -> Pose:
        """The pose after the wheels have turned to these angles since the beginning [rad]."""
        d_left, d_right = left - self._true_wheels[0], right - self._true_wheels[1]
        self._true_wheels = (left, right)
        distance = self._nominal_radius * 0.5 * abs(d_left + d_right)
        turned = self._nominal_radius * abs(d_right - d_left) / self._nominal_track
        along, about = self._rng.standard_normal(2).tolist()
        slips, which, how_far = self._rng.random(3).tolist()

        count_left, count_right = self._encoders(d_left, d_right, self._slip(distance, slips, which, how_far))
        s_left, s_right = self._left_radius * count_left, self._right_radius * count_right
        step, turn = 0.5 * (s_left + s_right), (s_right - s_left) / self._track
        if self._config.random:
            step += self._config.random_translation * math.sqrt(distance) * along
            turn += self._config.random_rotation * math.sqrt(distance + turned) * about
        self._integrate(step, turn)
        return self.pose

    def _slip(self, distance: float, slips: float, which: float, how_far: float) -> tuple[float, float]:
        """Angles by which the wheels spin ahead [rad], from three uniform numbers."""
        if slips >= -math.expm1(-self._config.slip_rate * distance):
            return 0.0, 0.0
        angle = -math.log1p(-how_far) * self._config.slip_distance / self._nominal_radius
        return (angle, 0.0) if which < 0.5 else (0.0, angle)

    def _encoders(self, d_left: float, d_right: float, slip: tuple[float, float]) -> tuple[float, float]:
        """Angles counted by the encoders since the last call [rad]."""
        counts = []
        for wheel, (turned, slipped) in enumerate(zip((d_left, d_right), slip, strict=True)):
            self._spun[wheel] += (turned + slipped) * (1.0 - self._config.lost_ticks)
            spun = self._spun[wheel]
            counted = math.floor(spun / self._tick) * self._tick if self._config.ticks else spun
            counts.append(counted - self._counted[wheel])
            self._counted[wheel] = counted
        return counts[0], counts[1]

    def _integrate(self, step: float, turn: float) -> None:
        """Move along an arc of length `step` [m] that turns by `turn` [rad]; exact for constant velocities."""
        half = 0.5 * turn
        chord = step * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0)
        self._x += chord * math.cos(self._theta + half)
        self._y += chord * math.sin(self._theta + half)
        self._theta += turn
