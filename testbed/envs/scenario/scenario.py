# SPDX-License-Identifier: MIT
"""World and start pose of an episode: fixed, drawn at random, or given at reset."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from gymnasium.error import Error
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage

from slam.se2 import Pose
from testbed.envs.scenario.generated_worlds import GeneratedWorlds
from testbed.presets import RobotPreset
from testbed.simulation.fleet.robot_group import Terrain
from worlds import TrueMap, World, WorldError, check_world, load, true_map

Start = Literal["random", "world"]
_CELL = 0.1
"""Side of the cells whose centres are the random start positions [m]."""
_ROOM = 0.15
"""Least distance between the footprint at a random start and the walls [m]."""
MAX_PREPARED_WORLDS = 256
"""Generated worlds that are kept in memory."""


class PreparedWorld(NamedTuple):
    """A world with all that an episode needs."""

    terrain: Terrain
    """Surfaces that stop bodies and beams."""
    true_map: TrueMap
    """True map at the lidar's height, cells of 0.05 m."""
    starts: NDArray[np.float64]
    """Positions [m] with room for the robot, (n, 2)."""


class ResetOptions(NamedTuple):
    """World and start given by the options of a reset; None = drawn or fixed as usual."""

    world: PreparedWorld | None = None
    start: Pose | None = None


class Scenario:
    """Chooses world and start of each episode; people and doors are removed from all worlds."""

    def __init__(self, world: str | World | GeneratedWorlds, start: Start, robot: RobotPreset) -> None:
        """Raises `WorldError` for an unknown world or one that the robot does not fit into."""
        if start not in ("random", "world"):
            raise ValueError(f"start must be 'random' or 'world', got {start!r}")
        self._robot, self._start = robot, start
        self._generated = self._cached()
        self._world, self._fixed = world, None
        if not isinstance(world, GeneratedWorlds):
            self._fixed = self._prepare(load(world) if isinstance(world, str) else world)

    def _cached(self) -> Callable[[int], PreparedWorld]:
        """Return `_generate` with a cache."""
        return lru_cache(MAX_PREPARED_WORLDS)(self._generate)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_generated"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._generated = self._cached()

    def parse_reset_options(self, options: Mapping[str, Any] | None) -> ResetOptions:
        """Check the options of a reset.

        They are `world` (name, file, `World`, or number of a generated one) and `start` `(x, y, theta)` [m, m, rad].
        Raises gymnasium's `Error` for anything else.
        """
        options = options or {}
        if unknown := sorted(set(options) - {"world", "start"}):
            raise Error(f"unknown reset options {', '.join(unknown)}, expected world or start")
        world = self._prepared_world(options["world"]) if options.get("world") is not None else None
        if options.get("start") is None:
            return ResetOptions(world)
        start = _pose(options["start"])
        if world is None and isinstance(self._world, GeneratedWorlds):
            raise Error("start needs the option world too: the number of a generated one")
        self._check_start(world or self._fixed, start)
        return ResetOptions(world, start)

    def draw(self, rng: Generator, options: ResetOptions) -> tuple[PreparedWorld, Pose]:
        """Return the world and the start `T_world_robot` (3,) of an episode."""
        world = options.world or self._fixed
        if world is None:
            assert isinstance(self._world, GeneratedWorlds)
            world = self._generated(self._world.draw(rng))
        if options.start is not None:
            return world, options.start
        if self._start == "world":
            at = world.terrain.world.start
            return world, np.array([at.x, at.y, at.theta])
        position = world.starts[rng.integers(len(world.starts))]
        return world, np.append(position, rng.uniform(-math.pi, math.pi))

    def _prepared_world(self, world: Any) -> PreparedWorld:
        try:
            if isinstance(world, World):
                return self._prepare(world)
            if isinstance(world, str):
                return self._prepare(load(world))
            if isinstance(self._world, GeneratedWorlds) and isinstance(world, int | np.integer):
                return self._generated(int(world))
        except ValueError as error:
            raise Error(f"option world: {error}") from error
        raise Error(f"option world must be a name, a World, or the number of a generated one, got {world!r}")

    def _check_start(self, prepared: PreparedWorld | None, start: Pose) -> None:
        assert prepared is not None
        world = prepared.terrain.world
        moved = world.model_copy(update={"start": world.start.model_copy(update={"x": start[0], "y": start[1]})})
        try:
            check_world(moved, footprint_radius=self._robot.footprint_radius)
        except WorldError as error:
            raise Error(f"option start: {error}") from error

    def _generate(self, number: int) -> PreparedWorld:
        assert isinstance(self._world, GeneratedWorlds)
        return self._prepare(self._world.world(number))

    def _prepare(self, world: World) -> PreparedWorld:
        still = world.model_copy(update={"people": [], "doors": [], "tour": None})
        check_world(still, footprint_radius=self._robot.footprint_radius)
        height = self._robot.lidar_mount.height
        floor = true_map(still, _CELL)
        room = ndimage.distance_transform_edt(np.pad(floor.free, 1))[1:-1, 1:-1] * _CELL
        rows, cols = np.nonzero(room > self._robot.footprint_radius + _ROOM)
        if len(rows) == 0:
            raise WorldError(f"world {world.name!r}: no free spot has room for the robot {self._robot.name!r}")
        starts = (np.column_stack([cols, rows]) + 0.5) * _CELL + np.array(floor.origin[:2])
        return PreparedWorld(Terrain(still, height), true_map(still, height=height), starts)


def _pose(start: Any) -> Pose:
    """Return the pose (3,) that a user gave; raises gymnasium's `Error` for anything else."""
    try:
        pose = np.array(start, dtype=np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise Error(f"option start: expected three finite numbers (x, y, theta), got {start!r}")
    return pose
