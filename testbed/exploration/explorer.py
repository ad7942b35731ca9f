# SPDX-License-Identifier: MIT
"""Drivers that know only what the filter believes, by name: what `--driver explore` and the baselines are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, get_args

from numpy.random import Generator

from testbed.exploration.belief import Belief
from testbed.exploration.frontier_explorer import FrontierExplorer
from testbed.exploration.planning.goals import information_gain, nearest
from testbed.exploration.reactive import RandomWalk, WallFollower
from testbed.presets import LidarPreset, RobotPreset
from testbed.simulation.drivers.driver import DriverConfig, Strategy

STRATEGIES: tuple[Strategy, ...] = get_args(Strategy)


class Explorer(Protocol):
    """Steers a robot by what is believed."""

    @property
    def recoveries(self) -> int:
        """How often the robot had to free itself."""
        ...

    @property
    def finished(self) -> bool:
        """There is nothing left to explore, as far as this explorer can tell."""
        ...

    @property
    def stuck(self) -> bool:
        """Freeing the robot did not help; it is given up."""
        ...

    def command(self, belief: Belief) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s]."""
        ...

    def wait(self, stamp: float) -> None:
        """The robot was held up by others until now [s]: that is no lack of progress."""
        ...


def make_explorer(robot: RobotPreset, lidar: LidarPreset, config: DriverConfig, rng: Generator) -> Explorer:
    """The explorer that `config.strategy` names; rng: random numbers of the random walk."""
    makers: dict[Strategy, Callable[[], Explorer]] = {
        "random": lambda: RandomWalk(robot, config, rng),
        "wall": lambda: WallFollower(robot, config),
        "nearest": lambda: FrontierExplorer(robot, config, nearest),
        "information": lambda: FrontierExplorer(robot, config, information_gain(lidar.range_max)),
    }
    return makers[config.strategy]()
