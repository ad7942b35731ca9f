# SPDX-License-Identifier: MIT
"""The fast backend: exact arcs, exact rays on a segment grid, no contact forces, no slip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.physics._motion_kernels import Body, Vehicle, drive
from testbed.simulation.physics._ray_kernels import SegmentGrid, bin_segments, cast_rays
from testbed.simulation.physics.backend import STEP_RATE, AccelerationLimits, Hits, Motion
from worlds import World

_CELL = 0.7
"""Side of a bin [m]; 0.5 to 1 m are best among 500 walls and in a furnished office."""
_BORDER = 0.5137
"""Empty border [m]; the odd number keeps walls at round coordinates off the sides of the bins."""


class FastBackend:
    """A world and a robot whose wheels never slip.

    The rays equal PyBullet's to a micrometre, except at corners.
    """

    def __init__(self, world: World, robot: RobotPreset, limits: AccelerationLimits) -> None:
        """Bin the walls that the body can touch; those that the lidars see are binned with the first ray."""
        self._world = world
        self._seen: dict[float, SegmentGrid] = {}  # by height
        self.body = Body(
            state=np.array([world.start.x, world.start.y, world.start.theta, 0.0, 0.0, 0.0, 0.0]),
            vehicle=vehicle_of(robot, limits),
            solid=segment_grid(world.boundary_segments()),
            max_speed=robot.max_speed,
            max_turn_rate=robot.max_turn_rate,
            step_time=1.0 / STEP_RATE,
        )
        """State of the robot and the walls that stop it."""

    def drive(self, speed: float, turn_rate: float, steps: int) -> Motion:
        """Move the robot, see `Backend.drive`."""
        poses = np.empty((steps, 3))
        body = self.body
        contact = drive(body.state, (speed, turn_rate), body.step_time, body.vehicle, body.solid, poses)
        return Motion(poses, body.state[5:].copy(), contact)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64], reach: float, height: float) -> Hits:
        """Cast horizontal rays, see `Backend.cast`."""
        if height not in self._seen:
            self._seen[height] = segment_grid(self._world.boundary_segments(height, glass=False))
        return Hits(*cast_rays(self._seen[height], origins, directions, reach))

    def close(self) -> None:
        """Do nothing, because there is nothing to free."""


def vehicle_of(robot: RobotPreset, limits: AccelerationLimits) -> Vehicle:
    """Return the parameters of the motion of a robot."""
    return Vehicle(robot.wheel_radius, robot.track / 2.0, robot.footprint_radius, *limits)


def segment_grid(segments: NDArray[np.float64], cell: float = _CELL) -> SegmentGrid:
    """Bin segments `(x0, y0, x1, y1)` [m], (n, 4), into cells of that side [m]."""
    ends = segments.reshape(-1, 2) if len(segments) else np.zeros((1, 2))
    low, high = ends.min(axis=0) - _BORDER, ends.max(axis=0) + _BORDER
    cols, rows = np.ceil((high - low) / cell).astype(int).tolist()
    origin = (float(low[0]), float(low[1]))
    segments = np.ascontiguousarray(segments, dtype=np.float64)
    first, touching = bin_segments(segments, (rows, cols), origin, cell)
    return SegmentGrid(segments[touching], first, (rows, cols), origin, cell)
