# SPDX-License-Identifier: MIT
"""A world: its elements, the start and the tour of the robot, and its exact geometry.

One geometry is used everywhere: the physics engine's mesh, the ray caster and the true map are all made from
`World.boundary_segments`.
"""

from __future__ import annotations

import operator
from typing import Annotated

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field, model_validator
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from worlds.elements import Angle, Block, Box, Coordinate, Disc, Element, Model, Position, Wall
from worlds.file_names import Name
from worlds.movers import Door, Person

MAX_ELEMENTS = 50_000
"""Largest number of elements in one world."""
MAX_WAY_POINTS = 100_000
"""Largest number of way points of a tour, those of all its laps counted."""


class Start(Model):
    """Pose of the robot at the beginning, `T_world_robot`."""

    x: Coordinate = 0.0
    """Position [m]."""
    y: Coordinate = 0.0
    """Position [m]."""
    theta: Angle = 0.0
    """Heading [rad]."""


class Tour(Model):
    """Way points that a robot visits in order, from the start pose on."""

    points: Annotated[list[Position], Field(min_length=1, max_length=MAX_WAY_POINTS)]
    """Way points [m]."""
    closed: bool = False
    """After the last way point the robot returns to the first one."""
    laps: Annotated[int, Field(strict=True, ge=1, le=1000)] = 1
    """Number of rounds; more than one needs `closed`."""

    @model_validator(mode="after")
    def _laps_need_a_closed_tour(self) -> Tour:
        if self.laps > 1 and not self.closed:
            raise ValueError(f"laps = {self.laps} needs closed = true")
        if self.laps * len(self.points) > MAX_WAY_POINTS:
            visited = f"{self.laps} laps of {len(self.points)} way points are {self.laps * len(self.points):,}"
            raise ValueError(f"{visited}, expected at most {MAX_WAY_POINTS:,}")
        return self


class Difficulty(Model):
    """Measures of a world; see `worlds.measure_difficulty`."""

    area: float = Field(ge=0.0)
    """Floor that is connected with the start [m²]."""
    free_share: float = Field(ge=0.0, le=1.0)
    """That floor as a share of what the outline encloses."""
    loops: int = Field(ge=0)
    """Islands in that floor whose outline is at least 4 m long."""
    tour_length: float = Field(ge=0.0)
    """Length of the tour [m]."""
    observability: float = Field(ge=0.0, le=1.0)
    """How well a single scan constrains the position in its worst direction, median along the tour: twice the smaller
    eigenvalue of the mean of n nᵀ over all beams (n = normal of the surface hit, zero without a hit). 1 = walls in all
    directions, 0 = a bare corridor or nothing in range."""
    corridor_share: float = Field(ge=0.0, le=1.0)
    """Share of the tour with an observability below 0.1."""
    symmetry: float = Field(ge=0.0, le=1.0)
    """Largest share of wall cells that fall on wall cells (to 0.1 m) when the map is turned by 180 degrees or mirrored
    left to right or bottom to top."""


class World(Model):
    """Everything that a world consists of. Frozen; made by `worlds.load` or in code."""

    name: Name
    """Short name, which output directories are named after."""
    description: str = ""
    """One line that describes it."""
    start: Start = Start()
    """Start pose of the robot."""
    tour: Tour | None = None
    """Way points of the drive; None = no tour."""
    walls: list[Wall] = Field(default_factory=list)
    """Walls along polylines."""
    boxes: list[Box] = Field(default_factory=list)
    """Rectangular blocks."""
    discs: list[Disc] = Field(default_factory=list)
    """Round blocks."""
    polygons: list[Block] = Field(default_factory=list)
    """Blocks of any outline."""

    people: Annotated[list[Person], Field(max_length=1000)] = Field(default_factory=list)
    """People who walk."""
    doors: Annotated[list[Door], Field(max_length=1000)] = Field(default_factory=list)
    """Doors that swing."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Position of this world's origin in the frame of the map that it was made of [m]."""
    difficulty: Difficulty | None = None
    """Stored measures of this world; None = not stored."""

    @model_validator(mode="after")
    def _not_too_large(self) -> World:
        if len(self.elements) > MAX_ELEMENTS:
            raise ValueError(f"a world may hold {MAX_ELEMENTS} elements, this one has {len(self.elements)}")
        return self

    @property
    def elements(self) -> list[Element]:
        """All walls and blocks."""
        return [*self.walls, *self.boxes, *self.discs, *self.polygons]

    @property
    def heights(self) -> list[float]:
        """Heights at which an element ends [m], lowest first."""
        return sorted({element.height for element in self.elements})

    def cross_section(self, height: float = 0.0, *, glass: bool = True) -> BaseGeometry:
        """Return the union of all elements taller than `height` [m]: polygons and, for thin walls, lines.

        `glass=False` leaves out elements that are transparent to lidars.
        """
        return _KEPT.union(tuple(e for e in self.elements if e.height > height and (glass or not e.glass)))

    def boundary_segments(self, height: float = 0.0, *, glass: bool = True) -> NDArray[np.float64]:
        """Return the surfaces at `height` [m] as segments `(x0, y0, x1, y1)` [m], (n, 4).

        These are the outlines of the union of all solids, and the thin walls outside of them. No segment lies inside a
        solid.
        """
        return segments_of(surface_of(self.cross_section(height, glass=glass)))

    def free_space(self) -> Polygon | None:
        """Return the enclosed floor that contains the start; None if no outline encloses it, or it lies in a solid."""
        solid, start = self.cross_section(), Point(self.start.x, self.start.y)
        return None if solid.intersects(start) else floor_around(start, surface_of(solid))

    def path(self) -> NDArray[np.float64]:
        """Return the corners of the whole drive [m], (n, 2), from the start through all laps of the tour.

        A world without a tour gives the start alone.
        """
        corners = [(self.start.x, self.start.y)]
        if self.tour is not None:
            lap = [*self.tour.points, self.tour.points[0]] if self.tour.closed else self.tour.points
            corners += lap + lap[1:] * (self.tour.laps - 1)
        return np.array(corners, dtype=np.float64)


class _KeptUnions:
    """The unions of the last few sets of elements: drives through one world differ in start and tour only.

    Elements are frozen, so that the same objects have the same shapes.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._found: list[tuple[tuple[Element, ...], BaseGeometry]] = []

    def union(self, elements: tuple[Element, ...]) -> BaseGeometry:
        """Return the union of the shapes of these elements."""
        for known, union in self._found:
            if len(known) == len(elements) and all(map(operator.is_, known, elements)):
                return union
        union = shapely.union_all([element.shape() for element in elements])
        self._found = [(elements, union), *self._found[: self._most - 1]]
        return union


_KEPT = _KeptUnions(4)


def floor_around(start: Point, surface: BaseGeometry) -> Polygon | None:
    """Return the floor that the lines `surface` enclose and that contains the free point `start`; None if there is
    none."""
    faces = shapely.get_parts(shapely.polygonize([shapely.node(surface)]))
    return next((face for face in faces if isinstance(face, Polygon) and face.contains(start)), None)


def surface_of(shape: BaseGeometry) -> BaseGeometry:
    """Return the outlines of the polygons in `shape`, and the lines in it."""
    parts = shapely.get_parts(shape)
    areas = shapely.get_dimensions(parts) == 2
    return shapely.union_all([*shapely.boundary(parts[areas]), *parts[~areas]])


def segments_of(lines: BaseGeometry) -> NDArray[np.float64]:
    """Return the segments `(x0, y0, x1, y1)` [m], (n, 4), of all lines; collinear neighbours are joined."""
    merged = shapely.line_merge(lines) if lines.geom_type.startswith("Multi") else lines
    pieces = []
    for line in shapely.get_parts(shapely.simplify(merged, 0.0)):
        corners = shapely.get_coordinates(line)
        pieces.append(np.hstack([corners[:-1], corners[1:]]))
    return np.concatenate(pieces) if pieces else np.empty((0, 4))
