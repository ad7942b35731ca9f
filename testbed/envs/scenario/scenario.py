# SPDX-License-Identifier: MIT
"""Where an episode takes place: a world and a start pose, fixed, drawn at random, or asked for at reset."""

from __future__ import annotations

import math
from collections.abc import Mapping
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
"""Side of the cells in whose middles random starts lie [m]."""
_ROOM = 0.15
"""Random starts have this much room beside the footprint [m]."""
MAX_PREPARED_WORLDS = 256


class PreparedWorld(NamedTuple):
    """A world ready for robots."""

    terrain: Terrain
    """What bodies and beams meet."""
    true_map: TrueMap
    """Of the world at the lidar's height, cells of 0.05 m."""
    starts: NDArray[np.float64]
    """Positions [m] with room for the robot, (n, 2)."""


class ResetOptions(NamedTuple):
    """What the options of a reset ask for; None = as usual."""

    place: PreparedWorld | None = None
    start: Pose | None = None


class Scenario:
    """Chooses world and start of each episode. Worlds have no movers here: people and doors are left out."""

    def __init__(self, world: str | World | GeneratedWorlds, start: Start, robot: RobotPreset) -> None:
        """Raises `WorldError` for an unknown world or one that the robot does not fit into."""
        if start not in ("random", "world"):
            raise ValueError(f"start must be 'random' or 'world', got {start!r}")
        self._robot, self._start = robot, start
        self._places = lru_cache(MAX_PREPARED_WORLDS)(self._generate)
        self._world, self._fixed = world, None
        if not isinstance(world, GeneratedWorlds):
            self._fixed = self._prepare(load(world) if isinstance(world, str) else world)

    def parse_reset_options(self, options: Mapping[str, Any] | None) -> ResetOptions:
        """Check the options of a reset: `world` (name, file, `World`, or number of a generated one) and `start`
        `(x, y, theta)` [m, m, rad]. Raises gymnasium's `Error` for anything else."""
        options = options or {}
        if unknown := sorted(set(options) - {"world", "start"}):
            raise Error(f"unknown reset options {', '.join(unknown)}, expected world or start")
        place = self._prepared_world(options["world"]) if options.get("world") is not None else None
        if options.get("start") is None:
            return ResetOptions(place)
        start = _pose(options["start"])
        if place is None and isinstance(self._world, GeneratedWorlds):
            raise Error("start needs the option world too: the number of a generated one")
        self._check_start(place or self._fixed, start)
        return ResetOptions(place, start)

    def draw(self, rng: Generator, wish: ResetOptions) -> tuple[PreparedWorld, Pose]:
        """World and start `T_world_robot` (3,) of an episode."""
        place = wish.place or self._fixed
        if place is None:
            assert isinstance(self._world, GeneratedWorlds)
            place = self._places(self._world.draw(rng))
        if wish.start is not None:
            return place, wish.start
        if self._start == "world":
            at = place.terrain.world.start
            return place, np.array([at.x, at.y, at.theta])
        position = place.starts[rng.integers(len(place.starts))]
        return place, np.append(position, rng.uniform(-math.pi, math.pi))

    def _prepared_world(self, world: Any) -> PreparedWorld:
        try:
            if isinstance(world, World):
                return self._prepare(world)
            if isinstance(world, str):
                return self._prepare(load(world))
            if isinstance(self._world, GeneratedWorlds) and isinstance(world, int | np.integer):
                return self._places(int(world))
        except ValueError as error:
            raise Error(f"option world: {error}") from error
        raise Error(f"option world must be a name, a World, or the number of a generated one, got {world!r}")

    def _check_start(self, place: PreparedWorld | None, start: Pose) -> None:
        assert place is not None
        world = place.terrain.world
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
            raise WorldError(f"world {world.name!r}: no place with room for the robot {self._robot.name!r}")
        starts = (np.column_stack([cols, rows]) + 0.5) * _CELL + np.array(floor.origin[:2])
        return PreparedWorld(Terrain(still, height), true_map(still, height=height), starts)


def _pose(start: Any) -> Pose:
    """A pose (3,) from what a user gave; raises gymnasium's `Error` for anything else."""
    try:
        pose = np.array(start, dtype=np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise Error(f"option start: expected three finite numbers (x, y, theta), got {start!r}")
    return pose
