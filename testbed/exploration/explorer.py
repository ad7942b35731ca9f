# SPDX-License-Identifier: MIT
"""The strategies of `--driver explore` by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, get_args

from numpy.random import Generator

from testbed.exploration.belief import Belief
from testbed.exploration.frontier_explorer import FrontierExplorer
from testbed.exploration.planning.goals import most_information, nearest
from testbed.exploration.reactive import RandomWalk, WallFollower
from testbed.presets import LidarPreset, RobotPreset
from testbed.simulation.drivers.driver import DriverConfig, Strategy

STRATEGIES: tuple[Strategy, ...] = get_args(Strategy)


class Explorer(Protocol):
    """A strategy that steers a robot by the filter's estimate."""

    @property
    def recoveries(self) -> int:
        """Number of times that the robot backed off."""
        ...

    @property
    def finished(self) -> bool:
        """Whether nothing is left to explore, as far as this explorer can tell."""
        ...

    @property
    def stuck(self) -> bool:
        """Whether the explorer has given up, because backing off did not help."""
        ...

    def command(self, belief: Belief) -> tuple[float, float]:
        """Return speed [m/s] and turn rate [rad/s]."""
        ...

    def wait(self, stamp: float) -> None:
        """Do not count the time up to `stamp` [s] as lack of progress: someone stood in the way."""
        ...


def make_explorer(robot: RobotPreset, lidar: LidarPreset, config: DriverConfig, rng: Generator) -> Explorer:
    """Return the explorer that `config.strategy` names; rng: generator of the random walk."""
    makers: dict[Strategy, Callable[[], Explorer]] = {
        "random": lambda: RandomWalk(robot, config, rng),
        "wall": lambda: WallFollower(robot, config),
        "nearest": lambda: FrontierExplorer(robot, config, nearest),
        "information": lambda: FrontierExplorer(robot, config, most_information(lidar.range_max)),
    }
    return makers[config.strategy]()
