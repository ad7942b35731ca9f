# SPDX-License-Identifier: MIT
"""Exploration that drives to one frontier of the estimated map after another until none is left."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.exploration.belief import Belief
from testbed.exploration.collision_limiter import CollisionLimiter
from testbed.exploration.planning.floor import Cell, Floor, ShortestPaths
from testbed.exploration.planning.frontiers import MIN_LENGTH, Frontier, border_of, find_frontiers
from testbed.exploration.planning.goals import GoalChoice
from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.drivers.pursuit import PurePursuit
from testbed.simulation.drivers.stuck_recovery import StuckRecovery

MAX_PLAN_AGE = 2.0
"""A path is planned again after this time, because the map grows [s]."""
_GOAL_RADIUS = 0.6
"""A goal is kept as long as a frontier is within this distance of it [m]."""
_BLOCKED_RADIUS = 0.5
"""Goals this near to one that could not be reached are not tried again [m]."""
_FULL_TURN = 2.0 * math.pi
"""The explorer turns by this angle before it decides that no frontier is left [rad]."""

Point = NDArray[np.float64]


class FrontierExplorer:
    """Plans a path to a frontier, follows it by pure pursuit, then chooses the next frontier.

    Where the robot is stuck it backs off and blocks the goal. If no frontier is left it turns once, then finishes.
    """

    def __init__(self, robot: RobotPreset, config: DriverConfig, choose: GoalChoice) -> None:
        self._robot, self._config, self._choose = robot, config, choose
        self._limiter, self._recovery = CollisionLimiter(robot, config), StuckRecovery(config.patience)
        self._pursuit: PurePursuit | None = None
        self._goal: Point | None = None
        self._planned = -math.inf
        self._blocked: list[Point] = []
        self._failures = 0  # recoveries since the last goal was reached
        self._turned, self._heading = 0.0, math.nan
        self._finished = False

    @property
    def finished(self) -> bool:
        """Whether no frontier is left that the robot can reach."""
        return self._finished

    @property
    def stuck(self) -> bool:
        """Whether backing off did not help, more than `max_recoveries` times between two goals."""
        return self._failures > self._config.max_recoveries

    @property
    def recoveries(self) -> int:
        """Number of times that the robot backed off."""
        return self._recovery.count

    def wait(self, stamp: float) -> None:
        """Do not count the time up to `stamp` [s] as lack of progress."""
        self._recovery.wait(stamp)

    def command(self, belief: Belief) -> tuple[float, float]:
        """Return speed [m/s] and turn rate [rad/s]."""
        if self.finished or self.stuck:
            return 0.0, 0.0
        pose = belief.pose.tolist()
        before = self._recovery.count
        escape = self._recovery.command(belief.stamp, *pose)
        if self._recovery.count > before:
            self._give_up_goal()
        if escape is not None:
            return self._limiter.limited(*escape, belief), escape[1]
        if belief.stamp - self._planned >= MAX_PLAN_AGE or (self._pursuit is not None and self._pursuit.finished):
            self._plan(belief)
        if self._pursuit is None:
            return self._look_around(pose[2])
        speed, turn_rate = self._pursuit.command(*pose)
        return self._limiter.limited(speed, turn_rate, belief), turn_rate

    def _plan(self, belief: Belief) -> None:
        """Plan a path to the current goal if a frontier is still near it, else to a new one."""
        self._planned = belief.stamp
        if self._pursuit is not None and self._pursuit.finished:
            self._failures, self._goal = 0, None
        self._pursuit = None
        x, y, _ = belief.pose.tolist()
        floor = Floor(belief.map(), self._robot.footprint_radius)
        start = floor.nearest_open(x, y)
        if start is None:
            return
        paths = floor.shortest_paths_from(start)
        cell = self._kept_goal(floor, paths) or self._new_goal(floor, paths)
        if cell is None:
            self._goal = None
            return
        self._goal = floor.centre(cell)
        path = np.vstack([[x, y], paths.path(cell)])
        if np.hypot(*np.diff(path, axis=0).T).sum() < floor.cell:  # the robot is at the goal, and the frontier remains
            self._blocked.append(self._goal)
            self._goal = None
            return
        self._pursuit = PurePursuit(path, self._robot, self._config)
        self._turned, self._heading = 0.0, math.nan

    def _kept_goal(self, floor: Floor, paths: ShortestPaths) -> Cell | None:
        """Return the cell of the current goal if it can be reached and a frontier is still near it."""
        if self._goal is None:
            return None
        cell = floor.nearest_open(*self._goal.tolist())
        if cell is None or not np.isfinite(paths.costs[cell]):
            return None
        reach = round(_GOAL_RADIUS / floor.cell)
        row, col = cell
        window = np.s_[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1]
        length = int(border_of(floor)[window].sum()) * floor.cell
        return cell if length >= MIN_LENGTH else None

    def _new_goal(self, floor: Floor, paths: ShortestPaths) -> Cell | None:
        """Return the cell of the next frontier; None if none is left."""
        frontiers = [found for found in find_frontiers(floor, paths) if not self._is_blocked(floor, found)]
        return self._choose(floor, frontiers).goal if frontiers else None

    def _is_blocked(self, floor: Floor, frontier: Frontier) -> bool:
        at = floor.centre(frontier.goal)
        return any(math.dist(at, other) < _BLOCKED_RADIUS for other in self._blocked)

    def _give_up_goal(self) -> None:
        """Block the current goal, because the robot did not reach it, and plan again."""
        self._failures += 1
        self._planned = -math.inf
        if self._goal is not None:
            self._blocked.append(self._goal)
            self._goal = None

    def _look_around(self, theta: float) -> tuple[float, float]:
        """Turn on the spot to see more; the exploration is finished after a full turn without a goal."""
        if not math.isnan(self._heading):
            self._turned += abs(math.remainder(theta - self._heading, 2.0 * math.pi))
        self._heading = theta
        self._finished = self._turned >= _FULL_TURN
        return 0.0, 0.0 if self._finished else 0.6 * min(self._config.turn_rate, self._robot.max_turn_rate)
