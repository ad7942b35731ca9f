# SPDX-License-Identifier: MIT
"""People and doors that move at random, are seen by the lidar and never touch the robot.

A person near the robot steps back along their path, whose ends lie off the tour; the robot waits for people in front of
it. A door opens for the robot and stands still while the robot is within its reach.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from shapely.geometry import LineString

from testbed.seeds import Stream, children
from testbed.simulation.movers._mover_kernels import nearest_mover
from testbed.simulation.physics.backend import Hits
from worlds import PERSON_RADIUS, Door, Person, World

_MIN_PERSON_DISTANCE = 1.0
"""Least distance between a person and the robot's footprint [m]."""
_LEG_RADIUS, _LEG_SPREAD, _STRIDE = 0.07, 0.1, 0.7
"""Legs of a person: radius, distance from the centre, length of a step [m]."""
_DOOR_SENSOR = 1.5
"""A door opens if the robot's footprint is this near to the circle that its leaf can reach [m]."""
_DOOR_MARGIN = 0.05
"""A door stands still if the robot's footprint is this near to the circle that its leaf can reach [m]."""
_SWING_RATE = 1.0
"""Angular speed of a door [rad/s]."""


class _Walker:
    """One person on their path: position and direction."""

    def __init__(self, person: Person, robot: tuple[float, float], radius: float, rng: Generator) -> None:
        self._person, self._way, self._rng = person, person.path(), rng
        self._along = float(rng.uniform(0.0, self._way.length))
        self._direction = 1.0 if rng.random() < 0.5 else -1.0
        self._pause, self._walked = 0.0, 0.0
        if self._distance(self._along, robot) < radius + _MIN_PERSON_DISTANCE:
            ends = (0.0, self._way.length)
            self._along = max(ends, key=lambda along: self._distance(along, robot))

    def _distance(self, along: float, robot: tuple[float, float]) -> float:
        x, y = _point(self._way, along)
        return math.hypot(x - robot[0], y - robot[1])

    def advance(self, seconds: float, robot: tuple[float, float], radius: float) -> None:
        """Walk on, pause, or step back from a robot of that footprint radius [m]."""
        if self._pause > 0.0:
            self._pause -= seconds
        step = 0.0 if self._pause > 0.0 else self._direction * self._person.speed * seconds
        now = self._distance(self._along, robot)
        if now < radius + _MIN_PERSON_DISTANCE:
            step = self._retreat(self._person.speed * seconds, now, robot)
        elif self._distance(self._along + step, robot) < radius + _MIN_PERSON_DISTANCE:
            step, self._direction = 0.0, -self._direction
        along = min(max(self._along + step, 0.0), self._way.length)
        self._walked += abs(along - self._along)
        self._along = along
        if (along == 0.0 and self._direction < 0) or (along == self._way.length and self._direction > 0):
            self._direction = -self._direction
            self._pause = float(self._rng.uniform(0.5, 1.5)) * self._person.pause

    def _retreat(self, step: float, now: float, robot: tuple[float, float]) -> float:
        """Return the signed step along the path that leads away from the robot, or 0."""
        self._pause = 0.0
        best = max((step, -step), key=lambda s: self._distance(self._along + s, robot))
        if self._distance(self._along + best, robot) <= now:
            return 0.0
        self._direction = math.copysign(1.0, best)
        return best

    @property
    def position(self) -> tuple[float, float]:
        """Centre of the person [m]."""
        return _point(self._way, self._along)

    def legs(self) -> list[tuple[float, float, float]]:
        """Return circles `(x, y, radius)` [m] of both legs, which swing in turn."""
        x, y = self.position
        ahead = _point(self._way, min(self._along + 0.01, self._way.length))
        behind = _point(self._way, max(self._along - 0.01, 0.0))
        heading = math.atan2(ahead[1] - behind[1], ahead[0] - behind[0])
        cos, sin = math.cos(heading), math.sin(heading)
        swing = 0.25 * _STRIDE * math.sin(math.pi * self._walked / _STRIDE)
        return [
            (x + side * cos * swing - side * sin * _LEG_SPREAD, y + side * sin * swing + side * cos * _LEG_SPREAD,
             _LEG_RADIUS)
            for side in (1.0, -1.0)
        ]  # fmt: skip


class _Leaf:
    """One door and its angle."""

    def __init__(self, door: Door, rng: Generator) -> None:
        self._door, self._rng = door, rng
        self._opened = 1.0 if rng.random() < 0.5 else 0.0
        self._wants_open = self._opened == 1.0
        self._stay = float(rng.exponential(door.stay))

    def advance(
        self, seconds: float, robot: tuple[float, float], radius: float, people: list[tuple[float, float]]
    ) -> None:
        """Swing on, or stand still near a robot of that footprint radius [m]; open for robot and people."""
        door = self._door
        gap = math.hypot(door.x - robot[0], door.y - robot[1]) - door.width - radius
        person = min((math.hypot(door.x - x, door.y - y) for x, y in people), default=math.inf)
        self._stay -= seconds
        if gap < _DOOR_SENSOR or person - door.width - PERSON_RADIUS < _DOOR_SENSOR:
            self._wants_open = True
        elif self._stay <= 0.0:
            self._wants_open = not self._wants_open
            self._stay = float(self._rng.exponential(door.stay))
        if gap > _DOOR_MARGIN:
            change = _SWING_RATE * seconds / max(abs(door.swing), 1e-6)
            self._opened = min(max(self._opened + (change if self._wants_open else -change), 0.0), 1.0)

    def segment(self) -> tuple[float, float, float, float]:
        """Return the leaf from the hinge to its tip [m]."""
        door = self._door
        angle = door.closed + self._opened * door.swing
        return door.x, door.y, door.x + door.width * math.cos(angle), door.y + door.width * math.sin(angle)


class Movers:
    """All people and doors of a world, moved at a constant rate."""

    def __init__(self, world: World, footprint_radius: float, period: float, stream: Stream) -> None:
        """footprint_radius: that of the robot [m]; period: time between two calls of `advance` [s]; stream: seed of the
        motion"""
        robot = (world.start.x, world.start.y)
        people, doors = children(stream, 2)
        self._walkers = [
            _Walker(person, robot, footprint_radius, np.random.default_rng(child))
            for person, child in zip(world.people, children(people, len(world.people)), strict=True)
        ]
        self._leaves = [
            _Leaf(door, np.random.default_rng(child))
            for door, child in zip(world.doors, children(doors, len(world.doors)), strict=True)
        ]
        self._radius, self._period = footprint_radius, period
        self._first_index = 0
        self._circles, self._segments = [self.circles()], [self.segments()]

    def __bool__(self) -> bool:
        return bool(self._walkers or self._leaves)

    def circles(self) -> NDArray[np.float64]:
        """Legs `(x, y, radius)` [m], (legs, 3), now."""
        return np.array([leg for walker in self._walkers for leg in walker.legs()]).reshape(-1, 3)

    def segments(self) -> NDArray[np.float64]:
        """Return the door leaves `(x0, y0, x1, y1)` [m] at the current time, (doors, 4)."""
        return np.array([leaf.segment() for leaf in self._leaves]).reshape(-1, 4)

    def people(self) -> NDArray[np.float64]:
        """Return the centres of all people [m] at the current time, (people, 2)."""
        return np.array([walker.position for walker in self._walkers]).reshape(-1, 2)

    def advance(self, x: float, y: float) -> None:
        """Move all people and doors by one period while the robot is at (x, y) [m]."""
        if not self:
            return
        for walker in self._walkers:
            walker.advance(self._period, (x, y), self._radius)
        people = [walker.position for walker in self._walkers]
        for leaf in self._leaves:
            leaf.advance(self._period, (x, y), self._radius, people)
        self._circles.append(self.circles())
        self._segments.append(self.segments())

    def in_the_way(self, x: float, y: float, theta: float, stopping_distance: float) -> bool:
        """Return whether a robot at this pose must wait, because someone or a closing door is in front.

        stopping_distance: distance that the robot needs to stop [m]
        """
        cos, sin = math.cos(theta), math.sin(theta)
        reach = self._radius + PERSON_RADIUS + 0.2 + stopping_distance
        half_width = self._radius + PERSON_RADIUS + 0.15
        for px, py in self.people().tolist():
            forward, left = cos * (px - x) + sin * (py - y), -sin * (px - x) + cos * (py - y)
            if 0.0 < forward < reach and abs(left) < half_width:
                return True
        ahead = LineString([(x, y), (x + (reach - self._radius) * cos, y + (reach - self._radius) * sin)])
        return any(
            ahead.distance(LineString([(x0, y0), (x1, y1)])) < self._radius
            for x0, y0, x1, y1 in self.segments().tolist()
        )

    def before(
        self,
        hits: Hits,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        times: NDArray[np.float64],
        known: NDArray[np.int64],
    ) -> Hits:
        """Return the hits of rays that end at movers if these are nearer than the walls.

        times (rays,): time of each ray [s]; known (rays,): number of instants since time 0 that are used for each
        """
        if not self:
            return hits
        positions = np.minimum(times / self._period - self._first_index, known - (1 + self._first_index))
        distances, cos_incidence = nearest_mover(
            np.array(self._circles), np.array(self._segments), positions, origins, directions
        )
        nearer = distances < hits.distances
        return Hits(np.where(nearer, distances, hits.distances), np.where(nearer, cos_incidence, hits.cos_incidence))

    def forget_before(self, time: float) -> None:
        """Drop the positions before `time` [s]."""
        drop = min(max(int(time / self._period) - self._first_index, 0), len(self._circles) - 1)
        del self._circles[:drop], self._segments[:drop]
        self._first_index += drop


def _point(way: LineString, along: float) -> tuple[float, float]:
    point = way.interpolate(min(max(along, 0.0), way.length))
    return point.x, point.y
