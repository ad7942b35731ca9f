# SPDX-License-Identifier: MIT
"""Odometry from wheel encoders, with the errors of real wheels.

Simulated wheels hardly slip, so the errors are added here: a systematic part, drawn once per run (wheel radius, track:
Borenstein and Feng, UMBmark, 1996), and a random part whose variance grows with the distance driven and the angle
turned, so that it does not depend on the rate of the odometry.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.presets import RobotPreset
from testbed.simulation.robot._odometry_kernels import ODOMETER, Encoders, Odometer, read_wheels
from testbed.simulation.robot.random_rows import RandomRows


class _Grade(NamedTuple):
    """Standard deviations of the systematic errors of a run."""

    distance: float
    rotation: float


GRADES = {"good": _Grade(0.005, 0.01), "typical": _Grade(0.02, 0.03), "poor": _Grade(0.05, 0.10)}
"""Standard deviations as shares of distance and rotation. They are ours, after mvsim's N(1, 0.02) forward and N(1,
0.03) in yaw for `typical`."""
_UNEQUAL_WHEELS = 0.03
"""Standard deviation of the difference of both wheel radii, as a share of the distance error (ours): two wheels are
more alike than their nominal radius is exact. With `typical` and a track of 0.23 m it bends a straight line by 0.15
degrees a metre."""


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """Errors of the wheel odometry; every layer can be switched off."""

    grade: Literal["good", "typical", "poor"] = "typical"
    """Size of the systematic errors."""
    systematic: bool = True
    """Add errors of wheel radii and track, drawn once per run."""
    random: bool = True
    """Add random errors that grow with the root of distance and rotation."""
    ticks: bool = True
    """Let encoders count whole ticks."""
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
    recovered_share: float = 0.0
    """Share of the random error of heading that the odometry makes good again on the way [1]: castors and backlash
    turn it to and fro."""
    recovery_length: float = 1.0
    """Way on which all but 1/e of that share is made good; a radian counts as a metre [m]."""
    unsigned: bool = False
    """Count driving backward as driving forward, as encoders of one channel do."""
    distance_scale: float = 1.0
    """Metres that odometry counts for each metre driven; the errors of the grade come on top."""
    rotation_scale: float = 1.0
    """Radians that odometry counts for each radian turned; the errors of the grade come on top."""
    drift: float = 0.0
    """Heading that odometry gains for each metre driven straight on, as with unequal wheels [rad/m]."""

    def __post_init__(self) -> None:
        if self.grade not in GRADES:
            raise ValueError(f"grade must be one of {', '.join(GRADES)}, got {self.grade!r}")
        for name in ("random_translation", "random_rotation", "slip_rate", "slip_distance"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        for name in ("distance_scale", "rotation_scale"):
            if not 0.5 <= getattr(self, name) <= 2.0:
                raise ValueError(f"{name} must be 0.5 to 2, got {getattr(self, name)}")
        if not abs(self.drift) <= 1.0:
            raise ValueError(f"drift must be -1 to 1 rad/m, got {self.drift}")
        if not 0.0 <= self.recovered_share <= 1.0:
            raise ValueError(f"recovered_share must be a share in [0, 1], got {self.recovered_share}")
        if not self.recovery_length > 0.0:
            raise ValueError(f"recovery_length must be above 0 m, got {self.recovery_length}")
        if not 0.0 <= self.lost_ticks < 1.0:
            raise ValueError(f"lost_ticks must be a share in [0, 1), got {self.lost_ticks}")


READING_UNIFORMS, READING_NORMALS = 3, 2
"""Number of random numbers of one odometry reading."""


def encoders_of(robot: RobotPreset, config: OdometryConfig) -> Encoders:
    """Return the sizes of the errors of each reading."""
    return Encoders(
        radius=robot.wheel_radius,
        track=robot.track,
        tick=2.0 * math.pi / robot.ticks_per_turn * config.ticks,
        random_translation=config.random_translation * config.random,
        random_rotation=config.random_rotation * config.random,
        slip_rate=config.slip_rate,
        slip_distance=config.slip_distance,
        lost_ticks=config.lost_ticks,
        recovered_share=config.recovered_share,
        recovery_length=config.recovery_length,
        unsigned=config.unsigned,
    )


def believed_wheels(robot: RobotPreset, config: OdometryConfig, rng: Generator) -> NDArray[np.float64]:
    """Draw the left radius, right radius and track [m], (3,), that odometry assumes in one run.

    Three numbers are drawn whatever layers are on.
    """
    distance, rotation, unequal = rng.standard_normal(3)
    grade = GRADES[config.grade]
    scale = 1.0 if config.systematic else 0.0
    size = config.distance_scale * (1.0 + scale * grade.distance * distance)
    turn = config.rotation_scale * (1.0 + scale * grade.rotation * rotation)
    half_difference = scale * 0.5 * _UNEQUAL_WHEELS * grade.distance * unequal + 0.5 * config.drift * robot.track / turn
    radii = robot.wheel_radius * size * np.array([1.0 - half_difference, 1.0 + half_difference])
    return np.append(radii, robot.track * size / turn)


class Odometry:
    """Integrates wheel angles to a pose `T_odom_robot`, which begins at zero.

    The number of random numbers does not depend on the layers, so that switching one off leaves the others' noise as it
    was.
    """

    def __init__(self, robot: RobotPreset, config: OdometryConfig, rng: Generator) -> None:
        self._encoders = encoders_of(robot, config)
        self._believed = believed_wheels(robot, config, rng)
        self._numbers = RandomRows(1, READING_UNIFORMS, READING_NORMALS)
        self._numbers.seed(0, rng)
        self._odometer = np.zeros(ODOMETER)

    @property
    def pose(self) -> Pose:
        """`T_odom_robot`, (3,); the heading is not wrapped."""
        return self._odometer[:3].copy()

    def advance(self, left: float, right: float) -> Pose:
        """Return the pose (3,) after the wheels have turned to these angles since the beginning [rad]."""
        odometer = self.odometer(1)
        read_wheels(
            odometer.state, (left, right), odometer.uniform[0], odometer.normal[0], odometer.believed, odometer.encoders
        )
        return self.pose

    def odometer(self, readings: int) -> Odometer:
        """Return the state with the random numbers of the next readings, at least one and at most so many: all of them
        must be made."""
        uniform, normal = self._numbers.next_of(0, readings)
        return Odometer(self._odometer, self._believed, self._encoders, uniform, normal)
