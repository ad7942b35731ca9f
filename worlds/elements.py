# SPDX-License-Identifier: MIT
"""Elements of a world: walls, boxes, discs and polygons, seen from above, each with a height.

All coordinates are in the world's frame: x to the east, y to the north, counter-clockwise angles.
"""

from __future__ import annotations

import math
from typing import Annotated

import shapely
from pydantic import BaseModel, ConfigDict, Field, model_validator
from shapely import affinity
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

MAX_COORDINATE = 1000.0
"""Worlds reach at most this far from their origin [m]; larger numbers are nearly always millimetres."""

Coordinate = Annotated[float, Field(strict=True, ge=-MAX_COORDINATE, le=MAX_COORDINATE, allow_inf_nan=False)]
"""A coordinate in the world's frame [m]."""
Length = Annotated[float, Field(strict=True, gt=0.0, le=MAX_COORDINATE, allow_inf_nan=False)]
"""A positive length [m]."""
Angle = Annotated[float, Field(strict=True, ge=-2.0 * math.pi, le=2.0 * math.pi, allow_inf_nan=False)]
"""An angle [rad]; larger numbers are nearly always degrees."""
Position = tuple[Coordinate, Coordinate]
"""A point `(x, y)` [m]."""

CIRCLE_QUADRANT_SEGMENTS = 8
"""Sides of a quarter of a disc: the polygon of 32 sides stays within 0.5 % of the radius."""


class Model(BaseModel):
    """Base of everything in a world file: frozen, without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Element(Model):
    """A solid on the floor."""

    name: str = Field("", max_length=200)
    """Name; used in error messages."""
    height: Length = 2.5
    """Top above the floor [m]; a lidar mounted higher looks over it."""
    glass: bool = False
    """Transparent to lidars, solid for robots."""

    def shape(self) -> BaseGeometry:
        """Return the footprint in the world's frame: polygons, or lines for walls without thickness."""
        raise NotImplementedError


class Opening(Model):
    """A gap in a wall: a door or a passage."""

    at: Annotated[float, Field(strict=True, ge=0.0, le=MAX_COORDINATE)]
    """Distance of its centre from the wall's first point, along the wall [m]."""
    width: Length = 0.95
    """Clear width [m]."""


class Wall(Element):
    """A wall along a polyline."""

    points: Annotated[list[Position], Field(min_length=2, max_length=100_000)]
    """Corners of the wall's centre line [m]."""
    closed: bool = False
    """The last corner is joined to the first."""
    thickness: Annotated[float, Field(strict=True, ge=0.0, le=10.0)] = 0.0
    """Thickness [m]; 0 = a surface without interior."""
    openings: list[Opening] = Field(default_factory=list)
    """Gaps."""

    @model_validator(mode="after")
    def _openings_lie_in_the_wall(self) -> Wall:
        length = self._line.length
        for opening in self.openings:
            if opening.at > length:
                raise ValueError(
                    f"expected openings within the {length:.2f} m of the wall, got one at {opening.at:g} m"
                )
        return self

    @property
    def _line(self) -> LineString:
        """Centre line of the wall."""
        return LineString([*self.points, self.points[0]] if self.closed else self.points)

    def shape(self) -> BaseGeometry:
        """Return lines, or polygons if the wall has a thickness. Corners are mitred, ends are cut square."""
        line = self._line
        parts: BaseGeometry = line if not self.openings else _without_openings(line, self.openings)
        if self.thickness == 0.0:
            return parts
        if self.closed and not self.openings:
            ring = shapely.LinearRing(self.points)
            return ring.buffer(self.thickness / 2.0, join_style="mitre")
        return parts.buffer(self.thickness / 2.0, cap_style="flat", join_style="mitre")


def _without_openings(line: LineString, openings: list[Opening]) -> BaseGeometry:
    """Return the parts of `line` that lie in none of the openings."""
    parts, begin = [], 0.0
    for opening in sorted(openings, key=lambda opening: opening.at):
        end = opening.at - opening.width / 2.0
        if end > begin:
            parts.append(substring(line, begin, end))
        begin = max(begin, opening.at + opening.width / 2.0)
    if begin < line.length:
        parts.append(substring(line, begin, line.length))
    return shapely.union_all(parts)


class Box(Element):
    """A rectangular block."""

    x: Coordinate
    """Centre [m]."""
    y: Coordinate
    """Centre [m]."""
    width: Length
    """Side along the box's own x axis [m]."""
    depth: Length
    """Side along the box's own y axis [m]."""
    rotation: Angle = 0.0
    """Counter-clockwise rotation about the centre [rad]."""

    def shape(self) -> BaseGeometry:
        """Return the rectangle as a polygon."""
        half_w, half_d = self.width / 2.0, self.depth / 2.0
        box = shapely.box(self.x - half_w, self.y - half_d, self.x + half_w, self.y + half_d)
        return affinity.rotate(box, self.rotation, origin=(self.x, self.y), use_radians=True)


class Disc(Element):
    """A round pillar, bin or plant, drawn as a polygon of 32 sides."""

    x: Coordinate
    """Centre [m]."""
    y: Coordinate
    """Centre [m]."""
    radius: Length
    """Radius [m]."""

    def shape(self) -> BaseGeometry:
        """Return the disc as a polygon."""
        return Point(self.x, self.y).buffer(self.radius, quad_segs=CIRCLE_QUADRANT_SEGMENTS)


class Block(Element):
    """A solid block of any outline (`[[polygons]]` in files)."""

    points: Annotated[list[Position], Field(min_length=3, max_length=100_000)]
    """Corners of the outline [m], in either direction; the last is joined to the first."""
    holes: list[Annotated[list[Position], Field(min_length=3, max_length=100_000)]] = Field(default_factory=list)
    """Outlines of holes in it [m]."""

    def shape(self) -> BaseGeometry:
        """Return the outline as a polygon."""
        return Polygon(self.points, self.holes)
