# SPDX-License-Identifier: MIT
"""The relief of walls: each decimetre of them stands where the beams of the log ended, not where a grid cell does.

Real walls have frames, shelves, and pipes of some centimetres. The map knows them to a cell, and `walls` draws them
straight; a filter finds its place between straight walls more easily than between those of the log.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.frame_table import FrameTable
from testbed.twin.returns import ComparedScan, compare_scans, thinned
from testbed.twin.wall_pieces import WallPieces
from testbed.twin.walls import CLEARED
from worlds import Wall, World

Floats = NDArray[np.float64]

PIECE = 0.1
"""Longest straight piece of a wall [m]; neighbouring beams at some metres are about that far apart."""
MIN_READINGS = 5
"""Half pieces with fewer readings tell nothing."""
NEAR = 0.3
"""Readings farther than this from a wall tell nothing of it [m]."""
MAX_MOVE = 0.1
"""Walls are moved by at most this [m]: what is farther off is on the map."""
MAX_COSINE = 0.95
"""Two pieces whose normals agree better than this are one wall, which is moved along its normal, not a corner."""
PASSES = 3
"""What a beam meets depends on where the walls stand: it is found anew so many times."""
MAX_SCANS = 2000
"""Scans that the walls are moved to, spread over the log."""


def with_relief(world: World, table: FrameTable, path: Pose, scans: NDArray[np.int64], driven: Pose) -> World:
    """Move the walls of a twin to where those scans end, seen from the path `T_world_robot` (m, 3) of all scans.

    They do not come nearer to the way of the robot's centre, `T_world_robot` (n, 3), than `CLEARED`: it passes there.
    """
    straight = [_pieces(np.array(wall.points)) for wall in world.walls]
    way = shapely.LineString(driven[:, :2])
    shapely.prepare(way)
    rings, scans = straight, thinned(scans, MAX_SCANS)
    for _ in range(PASSES):
        world = world.model_copy(update={"walls": _walls(world.walls, rings)})
        moved = _moved(rings, compare_scans(world, table, path, scans))
        rings = [_limited(*ends, way) for ends in zip(straight, moved, strict=True)]
    return world.model_copy(update={"walls": _walls(world.walls, rings)})


def _pieces(ring: Floats) -> Floats:
    """Return the corners (n, 2) of a closed wall with points between them, at most `PIECE` apart."""
    return shapely.get_coordinates(shapely.segmentize(shapely.linearrings(ring), PIECE))[:-1]


def _walls(walls: Iterable[Wall], rings: Iterable[Floats]) -> list[Wall]:
    """Return the walls with those corners (n, 2) each."""
    return [
        wall.model_copy(update={"points": [(x, y) for x, y in ring.round(4).tolist()]})
        for wall, ring in zip(walls, rings, strict=True)
    ]


def _moved(rings: list[Floats], compared: Iterable[ComparedScan]) -> list[Floats]:
    """Move the points of closed walls (n, 2) by the median distance of the readings beside them."""
    begins = np.concatenate(rings)
    walls = WallPieces(begins, np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]))
    parts = [_offsets(walls, scan) for scan in compared]
    halves, offsets = (np.concatenate(part) for part in zip(*parts, strict=True))
    medians = _medians(halves, offsets, 2 * len(begins)).reshape(-1, 2)
    sizes = [len(ring) for ring in rings]
    before = np.concatenate([np.roll(np.arange(n), 1) + k for n, k in zip(sizes, _starts(sizes), strict=True)])
    # A point has the second half of the piece before it and the first half of its own beside it.
    moves = _moves(walls.normals[before], medians[before, 1], walls.normals, medians[:, 0])
    return np.split(begins + moves, _starts(sizes)[1:])


def _starts(sizes: list[int]) -> list[int]:
    """Return the number of the first point of each wall."""
    return [0, *itertools.accumulate(sizes[:-1])]


def _offsets(walls: WallPieces, scan: ComparedScan) -> tuple[NDArray[np.int64], Floats]:
    """Return the half pieces (k,) that the beams meet, and by how much they end off along the normal [m], (k,)."""
    met = walls.readings_of(scan, NEAR)
    return 2 * met.pieces + (met.along >= 0.5), met.off * met.cosines


def _medians(groups: NDArray[np.int64], values: Floats, count: int) -> Floats:
    """Return the median of the values (k,) of each group (count,), NaN where there are fewer than `MIN_READINGS`."""
    order = np.lexsort((values, groups))
    sizes = np.bincount(groups, minlength=count)
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    medians = np.full(count, np.nan)
    enough = sizes >= MIN_READINGS
    middle = first[enough] + sizes[enough] // 2
    medians[enough] = values[order][middle]
    return medians


def _moves(one_normals: Floats, one: Floats, other_normals: Floats, other: Floats) -> Floats:
    """Return how points move (n, 2) [m], by the distances (n,) along the normals (n, 2) of the pieces beside them.

    A corner meets both distances; on a straight wall, and where one is unknown (NaN), what is known counts.
    """
    known_one, known_other = np.isfinite(one), np.isfinite(other)
    a, b = np.where(known_one, one, other), np.where(known_other, other, one)
    n1 = np.where(known_one[:, None], one_normals, other_normals)
    n2 = np.where(known_other[:, None], other_normals, one_normals)
    cosine = np.sum(n1 * n2, axis=1)
    corner = np.abs(cosine) < MAX_COSINE
    square = np.where(corner, 1.0 - cosine**2, 1.0)
    at_corner = ((a - cosine * b) / square)[:, None] * n1 + ((b - cosine * a) / square)[:, None] * n2
    straight = 0.5 * (a[:, None] * n1 + b[:, None] * n2)
    moves: Floats = np.where(corner[:, None], at_corner, straight)
    moves[~(known_one | known_other)] = 0.0
    return moves


def _limited(places: Floats, moved: Floats, way: shapely.LineString) -> Floats:
    """Return moved points (n, 2), at most `MAX_MOVE` from their places (n, 2), and at these where the robot drove."""
    moves = moved - places
    size: Floats = np.maximum(np.hypot(*moves.T), 1e-12)
    reached = places + moves * np.minimum(1.0, MAX_MOVE / size)[:, None]
    free = np.logical_not(shapely.dwithin(shapely.points(reached), way, CLEARED))
    return np.where(free[:, None], reached, places)
