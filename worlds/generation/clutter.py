# SPDX-License-Identifier: MIT
"""Add clutter to a world: boxes and bins on the floor and against the walls, away from the tour."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.random import Generator
from shapely.geometry import LineString, Point
from shapely.geometry.base import BaseGeometry

from worlds.check import check_world
from worlds.elements import Box, Disc
from worlds.errors import WorldError
from worlds.movers import PERSON_CLEARANCE
from worlds.world import World

MAX_CLUTTER = 20.0
"""Largest density [objects per 10 m² of floor]."""


def add_clutter(world: World, density: float, *, clearance: float) -> World:
    """Return the world with `density` more objects per 10 m² of floor.

    A higher density keeps the objects of a lower one and adds more. All objects keep a distance of `clearance` [m] from
    the tour, the start, people's paths and doors, so that the same drive is possible.
    Raises `WorldError` if the density is out of range or the world has no closed floor.
    """
    if not 0.0 <= density <= MAX_CLUTTER:
        raise WorldError(f"clutter {density:g}, expected 0 to {MAX_CLUTTER:g} objects per 10 m²")
    floor = world.free_space()
    if floor is None:
        raise WorldError(f"world {world.name!r}: the start is not enclosed, expected a closed outline")
    path = world.path()
    drive = LineString(path) if len(path) > 1 else Point(path[0])
    walks = [person.path().buffer(max(clearance, PERSON_CLEARANCE)) for person in world.people]
    doors = [Point(door.x, door.y).buffer(door.width + clearance) for door in world.doors]
    kept_clear = shapely.union_all([drive.buffer(clearance), *walks, *doors])
    boxes, discs = scatter(floor, kept_clear, density, np.random.default_rng(0))
    cluttered = world.model_copy(
        update={"boxes": world.boxes + boxes, "discs": world.discs + discs, "difficulty": None}
    )
    check_world(cluttered)
    return cluttered


def scatter(
    floor: BaseGeometry, kept_clear: BaseGeometry, density: float, rng: Generator
) -> tuple[list[Box], list[Disc]]:
    """Place random objects on a floor, `density` per 10 m² as far as there is room, none of them in `kept_clear`."""
    boxes: list[Box] = []
    discs: list[Disc] = []
    x_low, y_low, x_high, y_high = floor.bounds
    outline = floor.boundary
    for k in range(round(density * floor.area / 10.0)):
        for _ in range(20):
            if rng.random() < 0.5:  # against a wall
                at = outline.interpolate(float(rng.uniform(0.0, outline.length)))
            else:
                at = Point(rng.uniform(x_low, x_high), rng.uniform(y_low, y_high))
            item = _random_object(f"thing {k + 1}", at, rng)
            if floor.distance(at) < 1e-6 and not kept_clear.intersects(item.shape()):
                (boxes if isinstance(item, Box) else discs).append(item)  # type: ignore[arg-type]
                break
    return boxes, discs


def _random_object(name: str, at: Point, rng: Generator) -> Box | Disc:
    if rng.random() < 0.3:
        return Disc(name=name, x=at.x, y=at.y, radius=float(rng.uniform(0.1, 0.3)))
    width, depth = rng.uniform(0.2, 1.0, 2).tolist()
    rotation = float(rng.uniform(-math.pi, math.pi)) if rng.random() < 0.3 else 0.0
    return Box(name=name, x=at.x, y=at.y, width=width, depth=depth, rotation=rotation)
