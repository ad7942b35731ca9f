# SPDX-License-Identifier: MIT
"""Rendering of an episode: pictures of the world from above, drawn in numpy, or the Rerun viewer."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled, UnsupportedMode
from numpy.typing import NDArray

from eval.map.grids import grid_from_true_map, resample
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose, compose, inverse, transform_points
from testbed.envs.scenario.scenario import PreparedWorld
from testbed.simulation.fleet.robot_group import Readings, RobotSetup
from testbed.views import NullView, Scene, Snapshot, View, ViewOptions, open_view

MODES = ("rgb_array", "human")
MAX_SIDE = 480
"""Largest side of a picture [pixels]."""
UNKNOWN, WALL, FLOOR, TRAIL, BEAM, ROBOT, NOSE = (
    np.array(colour, dtype=np.uint8)
    for colour in (
        (205, 205, 205), (30, 30, 30), (255, 255, 255), (150, 190, 240), (230, 120, 60), (30, 90, 180), (255, 255, 255)
    )
)  # fmt: skip


def check_render_mode(mode: str | None, allowed: tuple[str | None, ...] = (None, *MODES)) -> None:
    """Raise gymnasium's `UnsupportedMode` for a render mode that is not allowed."""
    if mode not in allowed:
        raise UnsupportedMode(f"render_mode must be one of {', '.join(map(repr, allowed))}, got {mode!r}")


class Canvas:
    """A picture of a map from above, on which points and robots are drawn."""

    def __init__(self, grid: OccupancyGrid) -> None:
        rows, cols = grid.probability.shape
        self._scale = min(1.0, MAX_SIDE / max(rows, cols))
        self._grid = grid
        height, width = max(1, math.ceil(rows * self._scale)), max(1, math.ceil(cols * self._scale))
        self.pixels: NDArray[np.uint8] = np.broadcast_to(UNKNOWN, (height, width, 3)).copy()
        """(height, width, 3); row 0 is at the top, the highest y."""
        for mask, colour in ((grid.known, None), (grid.occupied, WALL)):
            row, col = np.nonzero(mask)
            at = (row * self._scale).astype(np.intp), (col * self._scale).astype(np.intp)
            self.pixels[height - 1 - at[0], at[1]] = FLOOR if colour is None else colour

    def points(self, points: NDArray[np.float64], colour: NDArray[np.uint8]) -> None:
        """Draw points (n, 2) [m, map frame], one pixel each."""
        row, col = self._to_pixels(points)
        height, width = self.pixels.shape[:2]
        seen = (row >= 0) & (row < height) & (col >= 0) & (col < width)
        self.pixels[row[seen], col[seen]] = colour

    def robot(self, pose: Pose, radius: float, colour: NDArray[np.uint8]) -> None:
        """Draw a disc of that radius [m] with a line along its heading; pose (3,), map frame."""
        step = 0.5 * self._grid.resolution / self._scale
        sides = np.arange(-radius, radius + step, step)
        square = np.stack(np.meshgrid(sides, sides), axis=-1).reshape(-1, 2)
        self.points(pose[:2] + square[(square**2).sum(axis=1) <= radius**2], colour)
        along = np.arange(0.0, radius, step)[:, None]
        self.points(pose[:2] + along * [math.cos(pose[2]), math.sin(pose[2])], NOSE)

    def _to_pixels(self, points: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        cells = transform_points(inverse(self._grid.origin), points) / self._grid.resolution
        col, row = np.floor(cells * self._scale).astype(np.intp).T
        return self.pixels.shape[0] - 1 - row, col


class Screen:
    """Shows the episodes of one robot in a render mode; mode None shows nothing."""

    def __init__(self, mode: str | None, setup: RobotSetup) -> None:
        self._mode, self._setup = mode, setup
        self._view: View = NullView()
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._world: PreparedWorld | None = None
        self._trail: list[Pose] = []
        self._truth, self._ranges = np.zeros(3), np.empty(0)
        self._periods = 0

    def __getstate__(self) -> dict[str, Any]:
        """Leave an open viewer out: a copy opens one of its own with its next episode."""
        return self.__dict__ | {"_view": NullView(), "_folder": None}

    def begin(self, world: PreparedWorld, start: Pose) -> None:
        """Begin a new episode of a robot at `T_world_robot` (3,)."""
        self._world, self._trail, self._start, self._periods = world, [], start, 0
        if self._mode != "human":
            return
        self._view.close()
        self._folder = self._folder or tempfile.TemporaryDirectory(prefix="testbed-episode-")
        scene = Scene(
            title=world.terrain.world.name,
            true_map=grid_from_true_map(world.true_map),
            robot_radius=self._setup.robot.footprint_radius,
        )
        try:
            self._view = open_view(Path(self._folder.name) / "episode.rrd", scene, ViewOptions(window=True))
        except ValueError as error:
            raise DependencyNotInstalled(f"render_mode 'human': {error}") from error

    def show(self, readings: Readings, robot: int, snapshot: Callable[[Scan], Snapshot] | None = None) -> None:
        """Show one period; snapshot: makes the viewer's data of a scan, default: truth and odometry only."""
        if self._mode is None:
            return
        self._truth, self._ranges = readings.truth[robot], readings.ranges[robot]
        self._trail.append(self._truth)
        self._periods += 1
        if self._mode == "human":
            scan = scan_of(self._setup, self._ranges, self._periods * self._setup.period)
            made = snapshot(scan) if snapshot else self._snapshot(scan, readings.odometry[robot])
            self._view.show(made)

    def _snapshot(self, scan: Scan, odometry: Pose) -> Snapshot:
        return Snapshot(stamp=scan.stamp, estimate=odometry, odometry=odometry, truth=self._truth, scan=scan)

    def picture(self, grid: OccupancyGrid | None = None, T_world_grid: Pose | None = None) -> NDArray[np.uint8] | None:
        """Return a picture of a map with trail, beams and robot, (height, width, 3), for "rgb_array"; None otherwise.

        grid: the map to show, whose frame is at `T_world_grid` (3,); None = the true map. All pictures of one world
        have the same size.
        """
        if self._mode != "rgb_array" or self._world is None:
            return None
        shown = grid_from_true_map(self._world.true_map)
        if grid is not None and T_world_grid is not None:
            shown = resample(grid, shown, T_world_grid)
        canvas = Canvas(shown)
        canvas.points(np.array(self._trail)[:, :2], TRAIL)
        angles = self._setup.steady_lidar.angles()
        hit = np.isfinite(self._ranges)
        ends = self._ranges[hit, None] * np.column_stack([np.cos(angles[hit]), np.sin(angles[hit])])
        T_world_lidar = compose(self._truth, self._setup.robot.lidar_mount.pose)
        canvas.points(transform_points(T_world_lidar, ends), BEAM)
        canvas.robot(self._truth, self._setup.robot.footprint_radius, ROBOT)
        return canvas.pixels

    def close(self) -> None:
        """Complete and remove the viewer's recording; may be called twice."""
        self._view.close()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None


def scan_of(setup: RobotSetup, ranges: NDArray[np.float64], stamp: float) -> Scan:
    """Return the scan of ranges (beams,) [m] whose first beam was fired at `stamp` [s]."""
    lidar = setup.steady_lidar
    return Scan(
        ranges=ranges,
        angles=lidar.angles(),
        range_min=lidar.range_min,
        range_max=lidar.range_max,
        stamp=stamp,
        mount=setup.robot.lidar_mount.pose,
        time_offsets=setup.time_offsets if setup.lidar_layers.motion else None,
    )
