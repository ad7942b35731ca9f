# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""One period of many robots at once: motion, odometry and a scan of each, by the kernels of a single robot."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._array_kernels import copy_values
from slam._jit import kernel
from testbed.simulation.physics._motion_kernels import Vehicle, drive
from testbed.simulation.physics._ray_kernels import SegmentGrid, cast_rays
from testbed.simulation.robot._lidar_kernels import Optics, place_beams, read_beams
from testbed.simulation.robot._odometry_kernels import Encoders, read_wheels


class SegmentGrids(NamedTuple):
    """The segment grid of each robot's world; robots in the same world share it."""

    segments: NDArray[np.float64]
    """`SegmentGrid.segments` of all worlds, one after the other [m]."""
    first: NDArray[np.int64]
    """`SegmentGrid.first` of all worlds, one after the other, pointing into `segments`."""
    begin: NDArray[np.int64]
    """Begin of the part of each robot's world in `first`, (robots,)."""
    shape: NDArray[np.int64]
    """Rows and columns of each robot's world, (robots, 2)."""
    origin: NDArray[np.float64]
    """Corner of each robot's world [m], (robots, 2)."""
    cell: float
    """Side of a cell [m]."""


class Surroundings(NamedTuple):
    """The walls around the robots."""

    solid: SegmentGrids
    """Surfaces that stop bodies."""
    seen: SegmentGrids
    """Surfaces that stop beams."""


class Robots(NamedTuple):
    """State of the robots; rows are robots."""

    body: NDArray[np.float64]
    """State of the bodies, as `drive` takes it, (robots, 7)."""
    odometer: NDArray[np.float64]
    """State of the odometers, as `read_wheels` takes it, (robots, 10)."""
    believed: NDArray[np.float64]
    """Radii and track that odometry assumes, (robots, 3) [m]."""
    device: NDArray[np.float64]
    """Errors of the lidars, as `lidar.draw_device` draws them, (robots, 5)."""


class Numbers(NamedTuple):
    """Random numbers drawn in advance, and the current row of each robot."""

    reading_uniform: NDArray[np.float64]
    """Uniform numbers of the odometry, (robots, rows, 3)."""
    reading_normal: NDArray[np.float64]
    """Normal numbers of the odometry, (robots, rows, 2)."""
    reading_row: NDArray[np.int64]
    """Current row of each robot, (robots,)."""
    beam_uniform: NDArray[np.float64]
    """Uniform numbers of the scans, (robots, rows, 2 beams)."""
    beam_normal: NDArray[np.float64]
    """Normal numbers of the scans, (robots, rows, 2 beams + 1)."""
    beam_row: NDArray[np.int64]
    """Current row of each robot, (robots,)."""


class Equipment(NamedTuple):
    """The parts that all robots have in common."""

    vehicle: Vehicle
    encoders: Encoders
    optics: Optics
    angles: NDArray[np.float64]
    """Directions of the beams [rad], (beams,)."""
    angle_noise: float
    """Standard deviation of a beam's direction [rad]."""
    positions: NDArray[np.float64]
    """Time of each beam, in steps of motion after the beginning of the period, (beams,)."""
    step_time: float
    """Duration of a step of motion [s]."""
    steps: int
    """Steps of motion in a period."""


@kernel
def grid_of(places, robot):
    """Return the segment grid of one robot's world."""
    rows, cols, begin = places.shape[robot, 0], places.shape[robot, 1], places.begin[robot]
    first = places.first[begin : begin + rows * cols + 1]
    origin = (places.origin[robot, 0], places.origin[robot, 1])
    return SegmentGrid(places.segments, first, (rows, cols), origin, places.cell)


@kernel
def step_robots(which, targets, robots, equipment, numbers, surroundings, contact, ranges):
    """Move the robots of the indices `which` by one period, in place; fill their rows of `contact` (robots,) and
    `ranges` (robots, beams) [m].

    targets (robots, 2): speed [m/s] and turn rate [rad/s]
    """
    n = equipment.angles.shape[0]
    poses, angles = np.empty((equipment.steps + 1, 3)), np.empty(n)
    for i in which:
        body = robots.body[i]
        copy_values(body, poses[0])
        contact[i] = drive(
            body,
            (targets[i, 0], targets[i, 1]),
            equipment.step_time,
            equipment.vehicle,
            grid_of(surroundings.solid, i),
            poses[1:],
        )
        row = numbers.reading_row[i]
        uniform, normal = numbers.reading_uniform[i, row], numbers.reading_normal[i, row]
        wheels = (body[5], body[6])
        read_wheels(robots.odometer[i], wheels, uniform, normal, robots.believed[i], equipment.encoders)

        row = numbers.beam_row[i]
        uniform, normal = numbers.beam_uniform[i, row], numbers.beam_normal[i, row]
        for k in range(n):
            angles[k] = equipment.angles[k] + normal[k] * equipment.angle_noise
        origins, directions = place_beams(poses, equipment.positions, robots.device[i, 2:], angles)
        distances, cos_incidence = cast_rays(
            grid_of(surroundings.seen, i), origins, directions, equipment.optics.range_max
        )
        readings = read_beams(
            distances, cos_incidence, uniform.reshape(2, n), normal[n:-1], equipment.optics, robots.device[i, :2]
        )
        copy_values(readings, ranges[i])
