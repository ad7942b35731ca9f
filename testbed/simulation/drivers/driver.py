# SPDX-License-Identifier: MIT
"""Who steers the robot: what the simulator asks of a driver, and the settings of all drivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, get_args

Strategy = Literal["information", "nearest", "wall", "random"]


@dataclass(frozen=True, kw_only=True)
class DriverConfig:
    """Who drives, and how; the robot's own limits apply besides."""

    kind: Literal["tour", "explore", "recorded", "teleop"] = "tour"
    """tour: along the tour of the world; explore: to the borders of what is mapped; recorded: the commands of
    --commands; teleop: by keyboard, in real time."""
    strategy: Strategy = "information"
    """Where explore goes: to the border of the known that promises most news per metre, to the nearest one, along
    walls, or anywhere."""
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
        if self.strategy not in get_args(Strategy):
            raise ValueError(f"strategy must be one of {', '.join(get_args(Strategy))}, got {self.strategy!r}")
        for name in ("speed", "turn_rate", "acceleration", "turn_acceleration", "lookahead", "patience"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


class Command(NamedTuple):
    """Velocities that a robot is commanded to keep from a time on."""

    stamp: float
    """[s]"""
    speed: float
    """Forward [m/s]."""
    turn_rate: float
    """Counter-clockwise [rad/s]."""


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
