# SPDX-License-Identifier: MIT
"""Check that a robot can drive in a world: the start is free, the outline closed, the tour drivable."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry import LineString, Point
from shapely.geometry.base import BaseGeometry

from worlds.elements import Element
from worlds.errors import WorldError
from worlds.movers import PERSON_CLEARANCE, PERSON_RADIUS
from worlds.world import World, floor_around, surface_of

MAX_USUAL_THICKNESS, MAX_USUAL_OPENING = 1.5, 10.0
"""Thicker walls, or wider openings, by their median, look like centimetres [m]."""


def check_world(world: World, *, footprint_radius: float = 0.0, source: str = "") -> None:
    """Raise `WorldError` unless every element is valid, the start is free, the outline closed and the tour drivable.

    footprint_radius: the robot's outer radius [m]; every point of the path keeps at least this distance from all
    surfaces. source: prefix of messages, such as the file's name; the world's name if empty.
    """
    source = source or f"world {world.name!r}"
    shapes = []
    for group in ("walls", "boxes", "discs", "polygons"):
        for index, element in enumerate(getattr(world, group)):
            shapes.append(element.shape())
            _check_shape(shapes[-1], f"{source}: {group}[{index}] {element.name!r}")
    start = Point(world.start.x, world.start.y)
    distances = shapely.distance(np.array(shapes, dtype=object), start)
    if shapes and (near := np.flatnonzero(distances <= footprint_radius)).size:
        raise WorldError(
            f"{source}: start ({world.start.x:g}, {world.start.y:g}) m lies in or within {footprint_radius:g} m "
            f"of {_described(world.elements[near[0]])}, expected a free place"
        )
    surface = surface_of(
        shapely.union_all([e for e, of in zip(shapes, world.elements, strict=True) if of.height > 0.0])
    )
    if floor_around(start, surface) is None:
        raise WorldError(
            f"{source}: the outline about start ({world.start.x:g}, {world.start.y:g}) m is not closed, "
            "expected walls that leave no way out"
        )
    _check_tour(world, surface, footprint_radius, source)
    _check_movers(world, surface, footprint_radius, source)


def unit_notes(world: World) -> tuple[str, ...]:
    """Return a note where the sizes of a world look like centimetres: walls or doors as large as rooms."""
    walls = [wall.thickness for wall in world.walls if wall.thickness > 0.0]
    openings = [opening.width for wall in world.walls for opening in wall.openings]
    thickness, width = (float(np.median(sizes)) if sizes else 0.0 for sizes in (walls, openings))
    if thickness <= MAX_USUAL_THICKNESS and width <= MAX_USUAL_OPENING:
        return ()
    large = f"walls {thickness:g} m thick" if thickness > MAX_USUAL_THICKNESS else f"openings {width:g} m wide"
    x_low, y_low, x_high, y_high = world.cross_section().bounds
    size = f"{x_high - x_low:.0f} x {y_high - y_low:.0f} m"
    return (f"world {world.name!r} of {size} has {large}: is it in centimetres?",)


def _check_shape(shape: BaseGeometry, source: str) -> None:
    if not shape.is_valid:
        raise WorldError(f"{source}: {shapely.is_valid_reason(shape)}, expected an outline that does not cross itself")
    if shape.is_empty or (shape.length == 0.0):
        raise WorldError(f"{source}: has no extent, expected a length above 0 m")


def _check_tour(world: World, surface: BaseGeometry, footprint_radius: float, source: str) -> None:
    path = world.path()
    if len(path) == 1:
        return
    legs = [LineString(leg) for leg in np.stack([path[:-1], path[1:]], axis=1)]
    clearance = np.asarray(shapely.distance(legs, surface))
    worst = int(np.argmin(clearance))
    if clearance[worst] <= footprint_radius:
        (x0, y0), (x1, y1) = path[worst], path[worst + 1]
        raise WorldError(
            f"{source}: tour from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g}) m passes {clearance[worst]:.2f} m from "
            f"{_described(_nearest(world, legs[worst]))}, expected more than {footprint_radius:.2f} m (the footprint)"
        )


def _check_movers(world: World, surface: BaseGeometry, footprint_radius: float, source: str) -> None:
    """Check that people have room to walk and to make way, and that open doors do not block the tour."""
    drive = LineString(world.path()) if world.tour is not None else Point(world.start.x, world.start.y)
    for index, person in enumerate(world.people):
        room = float(person.path().distance(surface))
        if room < PERSON_RADIUS:
            raise WorldError(
                f"{source}: people[{index}] {person.name!r} passes {room:.2f} m from a wall, "
                f"expected at least {PERSON_RADIUS} m"
            )
        for x, y in (person.points[0], person.points[-1]):
            distance = Point(x, y).distance(drive)
            if distance < footprint_radius + PERSON_CLEARANCE:
                raise WorldError(
                    f"{source}: people[{index}] {person.name!r} stops at ({x:g}, {y:g}) m, "
                    f"{distance:.2f} m from the tour, "
                    f"expected at least {footprint_radius + PERSON_CLEARANCE:.2f} m"
                )
    for index, door in enumerate(world.doors):
        distance = door.open_leaf().distance(drive)
        if distance <= footprint_radius:
            raise WorldError(
                f"{source}: doors[{index}] {door.name!r} stands {distance:.2f} m from the tour when open, "
                f"expected more than {footprint_radius:.2f} m (the footprint)"
            )


def _nearest(world: World, leg: LineString) -> Element:
    return min(world.elements, key=lambda element: _distance(element.shape(), leg))


def _distance(shape: BaseGeometry, leg: LineString) -> float:
    return float(shape.distance(leg))


def _described(element: Element) -> str:
    x, y = element.shape().representative_point().coords[0]
    label = f"{type(element).__name__.lower()} {element.name!r}" if element.name else type(element).__name__.lower()
    return f"{label} near ({x:.1f}, {y:.1f}) m"
