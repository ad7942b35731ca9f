# SPDX-License-Identifier: MIT
"""Drives from frontier to frontier over the estimated map until there are none left."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.exploration.belief import Belief
from testbed.exploration.guard import Guard
from testbed.exploration.planning.floor import Cell, Floor, Ways
from testbed.exploration.planning.frontiers import SMALLEST, Frontier, border_of, find_frontiers
from testbed.exploration.planning.goals import GoalChoice
from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.drivers.pursuit import PurePursuit
from testbed.simulation.drivers.stuck_recovery import BackOff

REPLAN = 2.0
"""The way is planned anew after this time at the latest [s]: the map grows meanwhile."""
_STILL_NEW = 0.6
"""A goal is kept as long as there is a frontier within this of it [m]."""
_SHUNNED = 0.5
"""Goals within this of one that could not be reached are not tried again [m]."""
_LOOK_ROUND = 2.0 * math.pi
"""Before an explorer believes that there is nothing left, it turns by this much [rad]."""

Point = NDArray[np.float64]


class FrontierExplorer:
    """Plans a way to a frontier, follows it by pure pursuit, and chooses the next. Backs off where it is stuck, shuns
    goals that it could not reach, and looks round before it believes that it has finished."""

    def __init__(self, robot: RobotPreset, config: DriverConfig, choose: GoalChoice) -> None:
        self._robot, self._config, self._choose = robot, config, choose
        self._guard, self._back_off = Guard(robot, config), BackOff(config.patience)
        self._pursuit: PurePursuit | None = None
        self._goal: Point | None = None
        self._planned = -math.inf
        self._shunned: list[Point] = []
        self._failures = 0  # since a goal was reached
        self._turned, self._heading = 0.0, math.nan
        self._finished = False

    @property
    def finished(self) -> bool:
        """There is no frontier left that could be reached."""
        return self._finished

    @property
    def stuck(self) -> bool:
        """Backing off did not help, from one goal to the next."""
        return self._failures > self._config.max_recoveries

    @property
    def recoveries(self) -> int:
        """How often the robot backed off."""
        return self._back_off.count

    def wait(self, stamp: float) -> None:
        """The robot was held up until now [s]."""
        self._back_off.wait(stamp)

    def command(self, belief: Belief) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s]."""
        if self.finished or self.stuck:
            return 0.0, 0.0
        pose = belief.pose.tolist()
        before = self._back_off.count
        escape = self._back_off.command(belief.stamp, *pose)
        if self._back_off.count > before:
            self._give_up_goal()
        if escape is not None:
            return escape
        if belief.stamp - self._planned >= REPLAN or (self._pursuit is not None and self._pursuit.finished):
            self._plan(belief)
        if self._pursuit is None:
            return self._look_round(pose[2])
        speed, turn_rate = self._pursuit.command(*pose)
        return self._guard.limited(speed, belief.obstacles()), turn_rate

    def _plan(self, belief: Belief) -> None:
        """Find the way to the goal at hand while it is worth going there, else to another one."""
        self._planned = belief.stamp
        if self._pursuit is not None and self._pursuit.finished:
            self._failures, self._goal = 0, None
        self._pursuit = None
        x, y, _ = belief.pose.tolist()
        floor = Floor(belief.map(), self._robot.footprint_radius)
        start = floor.nearest_open(x, y)
        if start is None:
            return
        ways = floor.ways_from(start)
        cell = self._kept_goal(floor, ways) or self._new_goal(floor, ways)
        if cell is None:
            self._goal = None
            return
        self._goal = floor.middle(cell)
        path = np.vstack([[x, y], ways.path(cell)])
        if np.hypot(*np.diff(path, axis=0).T).sum() < floor.cell:  # there already, and the frontier is still there
            self._shunned.append(self._goal)
            self._goal = None
            return
        self._pursuit = PurePursuit(path, self._robot, self._config)
        self._turned, self._heading = 0.0, math.nan

    def _kept_goal(self, floor: Floor, ways: Ways) -> Cell | None:
        """The cell of the goal at hand, if it can still be reached and there is still a frontier beside it."""
        if self._goal is None:
            return None
        cell = floor.nearest_open(*self._goal.tolist())
        if cell is None or not np.isfinite(ways.costs[cell]):
            return None
        reach = round(_STILL_NEW / floor.cell)
        row, col = cell
        window = np.s_[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1]
        news = int(border_of(floor)[window].sum()) * floor.cell
        return cell if news >= SMALLEST else None

    def _new_goal(self, floor: Floor, ways: Ways) -> Cell | None:
        """The cell of the frontier chosen next; None if there is none left."""
        frontiers = [found for found in find_frontiers(floor, ways) if not self._is_shunned(floor, found)]
        return self._choose(floor, frontiers).goal if frontiers else None

    def _is_shunned(self, floor: Floor, frontier: Frontier) -> bool:
        at = floor.middle(frontier.goal)
        return any(math.dist(at, other) < _SHUNNED for other in self._shunned)

    def _give_up_goal(self) -> None:
        """The robot did not get on: another goal may be easier."""
        self._failures += 1
        self._planned = -math.inf
        if self._goal is not None:
            self._shunned.append(self._goal)
            self._goal = None

    def _look_round(self, theta: float) -> tuple[float, float]:
        """Turn on the spot: perhaps there is more to see. After a whole turn without a goal the job is done."""
        if not math.isnan(self._heading):
            self._turned += abs(math.remainder(theta - self._heading, 2.0 * math.pi))
        self._heading = theta
        self._finished = self._turned >= _LOOK_ROUND
        return 0.0, 0.0 if self._finished else 0.6 * min(self._config.turn_rate, self._robot.max_turn_rate)
