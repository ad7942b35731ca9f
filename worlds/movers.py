# SPDX-License-Identifier: MIT
"""Things that move: people on their ways and swing doors. Lidars see them, the true map does not hold them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from shapely.geometry import LineString

from worlds.elements import Angle, Coordinate, Length, Model, Position

PERSON_RADIUS = 0.3
"""Radius of the circle about a walking person [m]."""
PERSON_CLEARANCE = 0.8
"""Distance of both ends of a person's way from the tour, beside the robot's footprint [m]: there a person who makes
way for the robot is out of its way."""


class Person(Model):
    """Someone who walks to and fro. A lidar below the knee sees two legs."""

    name: str = Field("", max_length=200)
    """Who it is; used in error messages."""
    points: Annotated[list[Position], Field(min_length=2, max_length=1000)]
    """Corners of the way [m]."""
    speed: Annotated[float, Field(strict=True, gt=0.0, le=3.0)] = 1.2
    """[m/s]"""
    pause: Annotated[float, Field(strict=True, ge=0.0, le=3600.0)] = 4.0
    """Mean stay at the ends [s]."""

    def way(self) -> LineString:
        """The way as a line."""
        return LineString(self.points)


class Door(Model):
    """A leaf that swings about a hinge. It opens for the robot, and closes and opens on its own while that is away."""

    name: str = Field("", max_length=200)
    """Which it is; used in error messages."""
    x: Coordinate
    """Hinge [m]."""
    y: Coordinate
    """Hinge [m]."""
    width: Length = 0.9
    """Of the leaf [m]."""
    closed: Angle
    """Direction from the hinge along the closed leaf [rad]."""
    swing: Angle
    """Rotation from closed to open, counter-clockwise if positive [rad]."""
    stay: Annotated[float, Field(strict=True, gt=0.0, le=3600.0)] = 10.0
    """Mean time that it stays open or closed [s]."""
