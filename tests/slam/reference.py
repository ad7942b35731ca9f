# SPDX-License-Identifier: MIT
"""A slow filter in plain Python, written from the paper and the docstrings: the oracle of the compiled one.

Grisetti, Stachniss, Burgard, T-RO 23(1), 2007, Algorithm 1, with the maps, the beam end point model and the motion
model as `slam` documents them. Nothing here imports a kernel; maps are dictionaries of cells, derivatives are
differences, and whatever can be found by trying all cases is.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from slam import se2

MEMORY = 64
LINE_REACH = 2
LINE_FLATNESS = 0.1
HALF_LENGTH = 0.75


def crossings(segment):
    """Exact parameters in (0, 1) at which a segment (4,) crosses lines of the lattice: two lists, for x and y."""
    x0, y0, x1, y1 = (Fraction(float(v)) for v in segment)
    found = []
    for a, b in ((x0, x1), (y0, y1)):
        low, high = min(a, b), max(a, b)
        lines = range(math.ceil(low), math.floor(high) + 1)
        found.append([t for t in ((line - a) / (b - a) for line in lines) if 0 < t < 1] if a != b else [])
    return found


def cells_on_segment(segment):
    """Cells (x, y) whose interior the segment (4,) crosses, in order: one for each piece between crossings."""
    x0, y0, x1, y1 = (Fraction(float(v)) for v in segment)
    cuts = sorted({Fraction(0), Fraction(1), *crossings(segment)[0], *crossings(segment)[1]})
    middles = [(a + b) / 2 for a, b in itertools.pairwise(cuts)]
    return [(math.floor(x0 + t * (x1 - x0)), math.floor(y0 + t * (y1 - y0))) for t in middles]


@dataclass
class Cell:
    """What a map knows of one cell."""

    hits: int = 0
    visits: int = 0
    mean: tuple[float, float] = (0.0, 0.0)
    wall: bool = False
    normal: tuple[float, float] | None = None


@dataclass
class Map:
    """One grid map, without bound: cells by number (x, y)."""

    cell: float
    wall_share: float
    radius: int
    cells: dict[tuple[int, int], Cell] = field(default_factory=dict)
    _found: dict[tuple[int, int], tuple[int, int] | None] = field(default_factory=dict)

    def integrate_scan(self, pose, rays):
        """Count the rays of one scan taken at `pose` (3,)."""
        self._found.clear()
        starts = se2.transform_points(pose, rays.origins) / self.cell
        ends = se2.transform_points(pose, rays.ends) / self.cell
        for start, end in zip(starts, ends, strict=True):
            for place in cells_on_segment((*start, *end))[:-1]:
                self._at(place).visits += 1
        for end, hit in zip(ends, rays.hit, strict=True):
            place = (math.floor(end[0]), math.floor(end[1]))
            cell = self._at(place)
            cell.visits += 1
            if hit:
                cell.hits += 1
                inside = end - place
                gain = 1.0 / min(cell.hits, MEMORY)
                cell.mean = tuple(np.add(cell.mean, gain * (inside - cell.mean)))
        for place in list(self.cells):
            self.cells[place].wall = self._is_wall(place)
        for end in ends[rays.hit]:
            place = (math.floor(end[0]), math.floor(end[1]))
            self.cells[place].normal = self.line_normal(place)

    def _is_wall(self, place):
        """Whether enough beams end in a cell, and as many as in the cells across any wall there."""
        cell = self.cells[place]
        outdone = 0
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            sides = [(place[0] + dx, place[1] + dy), (place[0] - dx, place[1] - dy)]
            outdone += any(cell.hits < self.cells[at].hits for at in sides if at in self.cells)
        return cell.hits > 0 and cell.hits >= self.wall_share * cell.visits and outdone < 2

    def _at(self, place):
        return self.cells.setdefault(place, Cell())

    def line_normal(self, place):
        """Unit normal of the line that the walls about a cell form, to one of 255 directions; None for no line."""
        near = range(-LINE_REACH, LINE_REACH + 1)
        points = [
            np.add(self.cells[at].mean, (dx, dy))
            for dy in near
            for dx in near
            if (at := (place[0] + dx, place[1] + dy)) in self.cells and self.cells[at].wall
        ]
        if len(points) < 3:
            return None
        away = np.array(points) - np.mean(points, axis=0)
        small, large = np.linalg.eigvalsh(away.T @ away)
        if small > LINE_FLATNESS * large:
            return None
        along = np.linalg.eigh(away.T @ away)[1][:, 1]
        turn = (math.atan2(along[1], along[0]) / math.pi + 0.5) % 1.0
        angle = (min(int(turn * 255.0), 254) + 0.5) / 255.0 * math.pi
        return (math.cos(angle), math.sin(angle))

    def nearest_wall(self, place):
        """The wall cell nearest to a cell within the radius, the lower, then the left one at a tie; or None."""
        if place not in self._found:
            self._found[place] = self._search(place)
        return self._found[place]

    def _search(self, place):
        found = [
            (dx * dx + dy * dy, dy, dx)
            for dy in range(-self.radius, self.radius + 1)
            for dx in range(-self.radius, self.radius + 1)
            if dx * dx + dy * dy <= self.radius**2
            and (at := (place[0] + dx, place[1] + dy)) in self.cells
            and self.cells[at].wall
        ]
        if not found:
            return None
        _, dy, dx = min(found)
        return (place[0] + dx, place[1] + dy)

    def residual(self, point):
        """Vector (2,) from the nearest piece of wall to a point (2,) [m], or None where no wall is near."""
        u = np.asarray(point) / self.cell
        place = self.nearest_wall((math.floor(u[0]), math.floor(u[1])))
        if place is None:
            return None
        wall = self.cells[place]
        away = u - np.add(place, wall.mean)
        if wall.normal is not None:
            direction = np.array([-wall.normal[1], wall.normal[0]])
            away = away - direction * np.clip(direction @ away, -HALF_LENGTH, HALF_LENGTH)
        return away * self.cell


@dataclass(frozen=True)
class Beams:
    """The beam end point model: cost of squared distance e [m^2] is weight / (2 sigma^2) e / (1 + e / outlier^2)."""

    sigma: float
    outlier: float
    weight: float
    far: float

    def cost(self, grid, pose, hits):
        """-log p(z | m, x) up to a constant; hits (K, 2) in the robot's frame."""
        total = 0.0
        for point in se2.transform_points(pose, hits):
            away = grid.residual(point)
            e = self.far**2 if away is None else float(away @ away)
            total += e / (1.0 + e / self.outlier**2)
        return 0.5 * self.weight / self.sigma**2 * total

    def matched(self, grid, pose, hits):
        """Share of the hits within the outlier distance of a wall."""
        away = [grid.residual(point) for point in se2.transform_points(pose, hits)]
        return sum(a is not None and a @ a <= self.outlier**2 for a in away) / len(hits)


def sigmas(motion, config):
    """Standard deviations (3, 3) of the components of the motion model: odometry good, failed, and robot jumped."""
    distance, angle = math.hypot(motion[0], motion[1]), abs(motion[2])
    position = (
        config.floor_translation
        + config.translation_from_translation * distance
        + config.translation_from_rotation * angle
    )
    heading = (
        config.floor_rotation + config.rotation_from_translation * distance + config.rotation_from_rotation * angle
    )
    along = min(config.failure_along * distance, config.failure_limit)
    return np.array(
        [
            (position, position, heading),
            (position + along, 2.0 * position, heading + config.failure_rotation * angle),
            (config.jump_along, config.jump_across, config.jump_rotation),
        ]
    )


def shares(config):
    """Share of the steps in which each component of the motion model holds, (3,)."""
    return np.array([1.0 - config.failure_share - config.jump_share, config.failure_share, config.jump_share])


def motion_cost(deviation, sigma, share_of):
    """-log of the motion model's density at a deviation (3,) from the predicted pose, seen from there."""
    logs = []
    for share, s in zip(share_of, sigma, strict=True):
        z = np.asarray(deviation) / s
        log_normal = -0.5 * float(z @ z) - 1.5 * math.log(2.0 * math.pi) - float(np.log(s).sum())
        logs.append(log_normal + math.log(share) if share > 0.0 else -math.inf)
    return -float(np.logaddexp.reduce(logs))
