# SPDX-License-Identifier: MIT
"""Features of a world, its route and the sensors: what may decide how many particles are needed."""

from __future__ import annotations

import numpy as np
import shapely

from testbed.simulation import SimulationConfig
from testbed.sweep.execution.drive_features import STEP, longest_unknown
from worlds import World, measure_difficulty

MAX_CLUTTER_SIZE = 1.5
"""Boxes and discs whose longest side is at most this long count as clutter [m]."""
Features = dict[str, float | int | str]


def features_of(world: World, config: SimulationConfig) -> Features:
    """Features of a drive, ready for JSON; lengths in metres, shares from 0 to 1.

    Raises `WorldError` if the outline of the world is open.
    """
    difficulty, lidar = measure_difficulty(world), config.lidar
    return {
        "area_m2": difficulty.area,
        "route_m": difficulty.tour_length,
        "loops": difficulty.loops,
        "largest_loop_m": largest_loop(world),
        "unknown_stretch_m": unknown_stretch(world),
        "corridor_share": difficulty.corridor_share,
        "determined_share": round(1.0 - difficulty.corridor_share, 3),
        "observability": difficulty.observability,
        "symmetry": difficulty.symmetry,
        "clutter_per_10_m2": clutter(world, difficulty.area),
        "lidar_range_m": lidar.range_max,
        "lidar_beams": lidar.beams,
        "lidar_view_deg": lidar.field_of_view_deg,
        "lidar_noise_m": lidar.noise_floor,
        "odometry_grade": config.odometry.grade,
    }


def largest_loop(world: World) -> float:
    """Length of the longest outline of an island in the floor [m]: what a robot drives at least to go round it."""
    floor = world.free_space()
    return 0.0 if floor is None else round(max((ring.length for ring in floor.interiors), default=0.0), 1)


def unknown_stretch(world: World) -> float:
    """Longest way of the route through floor that it has not passed before [m], see `longest_unknown`."""
    path = shapely.LineString(world.path()) if world.tour is not None else None
    if path is None or path.length == 0.0:
        return 0.0
    return longest_unknown(shapely.get_coordinates(path.interpolate(np.arange(0.0, path.length + STEP, STEP))))


def clutter(world: World, area: float) -> float:
    """Small boxes and discs per 10 m² of floor."""
    small = [box for box in world.boxes if max(box.width, box.depth) <= MAX_CLUTTER_SIZE]
    discs = [disc for disc in world.discs if 2.0 * disc.radius <= MAX_CLUTTER_SIZE]
    return round(10.0 * (len(small) + len(discs)) / area, 3) if area > 0.0 else 0.0
