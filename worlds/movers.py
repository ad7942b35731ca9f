# SPDX-License-Identifier: MIT
"""Things that move: people who walk and doors that swing. Lidars see them; the true map does not contain them."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field
from shapely.geometry import LineString

from worlds.elements import Angle, Coordinate, Length, Model, Position

PERSON_RADIUS = 0.3
"""Radius of the circle about a walking person [m]."""
PERSON_CLEARANCE = 0.8
"""Smallest distance of both ends of a person's path from the tour, in addition to the robot's footprint [m]: a person
who waits there lets the robot pass."""


class Person(Model):
    """A person who walks back and forth. A lidar below the knee sees two legs."""

    name: str = Field("", max_length=200)
    """Name; used in error messages."""
    points: Annotated[list[Position], Field(min_length=2, max_length=1000)]
    """Corners of the path [m]."""
    speed: Annotated[float, Field(strict=True, gt=0.0, le=3.0)] = 1.2
    """Walking speed [m/s]."""
    pause: Annotated[float, Field(strict=True, ge=0.0, le=3600.0)] = 4.0
    """Mean time spent at each end [s]."""

    def path(self) -> LineString:
        """Return the path as a line."""
        return LineString(self.points)


class Door(Model):
    """A leaf that swings about a hinge. It opens for the robot, and closes and opens at random without one nearby."""

    name: str = Field("", max_length=200)
    """Name; used in error messages."""
    x: Coordinate
    """Hinge [m]."""
    y: Coordinate
    """Hinge [m]."""
    width: Length = 0.9
    """Width of the leaf [m]."""
    closed: Angle
    """Direction from the hinge along the closed leaf [rad]."""
    swing: Angle
    """Rotation from closed to open, counter-clockwise if positive [rad]."""
    stay: Annotated[float, Field(strict=True, gt=0.0, le=3600.0)] = 10.0
    """Mean time that it stays open or closed [s]."""

    def open_leaf(self) -> LineString:
        """Return the leaf of the open door as a line."""
        angle = self.closed + self.swing
        tip = (self.x + self.width * math.cos(angle), self.y + self.width * math.sin(angle))
        return LineString([(self.x, self.y), tip])
