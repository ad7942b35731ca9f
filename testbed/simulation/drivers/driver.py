# SPDX-License-Identifier: MIT
"""The interface between the simulator and a driver, and the settings of all drivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, get_args

Strategy = Literal["information", "nearest", "wall", "random"]


@dataclass(frozen=True, kw_only=True)
class DriverConfig:
    """The driver and its limits; the robot's own limits apply too."""

    kind: Literal["tour", "explore", "recorded", "teleop"] = "tour"
    """tour: follow the tour of the world; explore: drive to the frontiers of the map; recorded: repeat the commands of
    --commands; teleop: drive by keyboard in real time."""
    strategy: Strategy = "information"
    """Strategy of explore: drive to the frontier with the largest information gain per metre, to the nearest frontier,
    along walls, or at random."""
    speed: float = 0.45
    """Cruising speed [m/s]."""
    turn_rate: float = 1.0
    """Largest turn rate [rad/s]."""
    acceleration: float = 0.5
    """Largest acceleration [m/s²]; with harder braking the simulated body pitches."""
    turn_acceleration: float = 3.0
    """Largest turn acceleration [rad/s²]."""
    lookahead: float = 0.4
    """Lookahead of pure pursuit: distance of the path point that the robot steers to [m]."""
    turn_on_spot_above: float = 0.9
    """If that point is farther to the side than this angle, the robot turns on the spot [rad]."""
    patience: float = 5.0
    """The robot backs off if it has made no progress for this time [s]."""
    max_recoveries: int = 5
    """The drive is given up after this many tries to back off."""

    def __post_init__(self) -> None:
        if self.strategy not in get_args(Strategy):
            raise ValueError(f"strategy must be one of {', '.join(get_args(Strategy))}, got {self.strategy!r}")
        for name in ("speed", "turn_rate", "acceleration", "turn_acceleration", "lookahead", "patience"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


class Command(NamedTuple):
    """Velocities that a robot is commanded to keep from a time on."""

    stamp: float
    """Time from which on it holds [s]."""
    speed: float
    """Forward speed [m/s]."""
    turn_rate: float
    """Turn rate, counter-clockwise [rad/s]."""


class Driver(Protocol):
    """Gives the command for each control period."""

    @property
    def finished(self) -> bool:
        """Whether the drive has ended as planned."""
        ...

    @property
    def stuck(self) -> bool:
        """Whether the drive was given up."""
        ...

    @property
    def share(self) -> float | None:
        """Share of the drive that is done, 0 to 1; None = unknown."""
        ...

    @property
    def recoveries(self) -> int:
        """Number of times that the robot backed off."""
        ...

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return speed [m/s] and turn rate [rad/s] for the robot at its true pose (x, y, theta) at the time `stamp`
        [s]."""
        ...

    def wait(self, stamp: float) -> tuple[float, float]:
        """Return the command 0, 0, because someone stands in the way; the time does not count as lack of progress."""
        ...
