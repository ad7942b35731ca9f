# SPDX-License-Identifier: MIT
"""Generate worlds from a seed: rooms, corridors, loops, blocks, mazes, warehouses, caves; connected and drivable."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Literal, NamedTuple, get_args

import numpy as np
import shapely
from numpy.random import Generator, SeedSequence
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from worlds.check import check_world
from worlds.elements import Block, Box, Position, Wall
from worlds.errors import WorldError
from worlds.generation.blocks import lay_out_blocks
from worlds.generation.clutter import MAX_CLUTTER, scatter
from worlds.generation.graph import closed_walk, lattice_edges, random_graph
from worlds.world import Start, Tour, World

Kind = Literal["rooms", "corridors", "loops", "blocks", "maze", "warehouse", "cave"]
KINDS: tuple[Kind, ...] = get_args(Kind)

CLEAR = 0.5
"""Smallest distance of generated tours from everything [m]: robots of that outer radius can drive them."""
_WALL = 0.2
"""Thickness of walls [m]."""
_MIN_SIDE, _MAX_SIDE = 8.0, 220.0
"""Limits of the sides of the area [m]."""
_SEEN_AGAIN = 12.0
"""Where a tour around blocks is back at its start, it goes on for this long [m]: a loop closes on known floor."""


class _Plan(NamedTuple):
    """A world before clutter is added: its elements and the path of the tour."""

    walls: list[Wall]
    boxes: list[Box]
    blocks: list[Block]
    path: list[Position]
    floor: BaseGeometry
    """Free floor, on which objects may be placed."""


def generate(
    kind: Kind,
    *,
    size: tuple[float, float] = (20.0, 15.0),
    clutter: float = 1.0,
    loops: int = 2,
    seed: int | SeedSequence = 0,
) -> World:
    """Make a random world with a tour through all of it.

    size: width and depth [m]; clutter: objects per 10 m² of floor; loops: number of edges that close a loop
    (`corridors` ignores it and has none, `warehouse` has those of its aisles); for `blocks` the number of blocks that
    corridors run around, so that 1 is a ring. The same arguments give the same world.
    Raises `WorldError` for an unknown kind or a size out of range.
    """
    if kind not in KINDS:
        raise WorldError(f"unknown kind of world {kind!r}, expected one of {', '.join(KINDS)}")
    if not all(_MIN_SIDE <= side <= _MAX_SIDE for side in size):
        raise WorldError(f"size {size[0]:g} x {size[1]:g} m, expected sides of {_MIN_SIDE:g} to {_MAX_SIDE:g} m")
    if not 0.0 <= clutter <= MAX_CLUTTER or loops < 0:
        raise WorldError(
            f"clutter {clutter:g} and loops {loops}, expected clutter of 0 to {MAX_CLUTTER:g}, 0 loops or more"
        )
    rng = np.random.default_rng(seed)
    plan = _PLANS[kind](size, loops, rng)
    boxes, discs = scatter(plan.floor, LineString(plan.path).buffer(CLEAR), clutter, rng)
    (x, y), (x_next, y_next) = plan.path[0], plan.path[1]
    world = World(
        name=kind,
        description=f"Generated: {kind}, {size[0]:g} m x {size[1]:g} m, clutter {clutter:g}, loops {loops}",
        start=Start(x=x, y=y, theta=math.atan2(y_next - y, x_next - x)),
        tour=Tour(points=plan.path[1:]),
        walls=plan.walls,
        boxes=plan.boxes + boxes,
        discs=discs,
        polygons=plan.blocks,
    )
    check_world(world, footprint_radius=CLEAR - 0.01)
    return world


def _lattice_plan(
    size: tuple[float, float], pitch: float, loops: int, rng: Generator, carve: Callable[[LineString], BaseGeometry]
) -> _Plan:
    """Carve the edges of a random graph on a lattice out of the solid."""
    cols, rows = (max(2, int(side / pitch)) for side in size)
    graph = random_graph(cols * rows, lattice_edges(cols, rows), loops, rng)
    pitch_x, pitch_y = size[0] / cols, size[1] / rows
    at = [((k % cols + 0.5) * pitch_x, (k // cols + 0.5) * pitch_y) for k in range(cols * rows)]
    parts = [carve(LineString([at[a], at[b]])) for a, b in graph.tree + graph.extra]
    floor = shapely.union_all(parts)
    path = _without_straight_corners([at[k] for k in closed_walk(graph)])
    return _Plan([], [], _carved(floor), path, floor)


def _maze(size: tuple[float, float], loops: int, rng: Generator) -> _Plan:
    return _lattice_plan(size, 2.0, loops, rng, lambda edge: edge.buffer(0.9, cap_style="square", join_style="mitre"))


def _corridors(size: tuple[float, float], loops: int, rng: Generator) -> _Plan:
    del loops
    return _loops(size, 0, rng)


def _loops(size: tuple[float, float], loops: int, rng: Generator) -> _Plan:
    def corridor(edge: LineString) -> BaseGeometry:
        return edge.buffer(float(rng.uniform(0.9, 1.3)), cap_style="square", join_style="mitre")

    return _lattice_plan(size, 5.0, loops, rng, corridor)


def _blocks(size: tuple[float, float], loops: int, rng: Generator) -> _Plan:
    layout = lay_out_blocks(size, loops, rng)
    cols, rows = len(layout.x), len(layout.y)
    at = [(layout.x[k % cols], layout.y[k // cols]) for k in range(cols * rows)]
    graph = random_graph(cols * rows, lattice_edges(cols, rows), cols * rows, rng)
    corners = [at[k] for k in closed_walk(graph)]
    path = _without_straight_corners([*corners, _towards(corners[0], corners[1], _SEEN_AGAIN)])
    return _Plan([], [], _carved(layout.floor), path, layout.floor)


def _towards(a: Position, b: Position, distance: float) -> Position:
    """Return the point at this distance from a on the way to b [m], or b if it is nearer."""
    share = min(1.0, distance / math.dist(a, b))
    return (round(a[0] + share * (b[0] - a[0]), 3), round(a[1] + share * (b[1] - a[1]), 3))


def _cave(size: tuple[float, float], loops: int, rng: Generator) -> _Plan:
    def gallery(edge: LineString) -> BaseGeometry:
        """Draw overlapping circles along the edge, none narrower than the robot needs."""
        steps = np.arange(0.0, edge.length + 0.3, 0.6)
        blobs = [edge.interpolate(s).buffer(float(rng.uniform(0.9, 1.6)), quad_segs=3) for s in steps]
        return shapely.union_all([*blobs, edge.buffer(0.8)])

    plan = _lattice_plan(size, 5.0, loops, rng, gallery)
    rough = plan.floor.simplify(0.1)
    return plan._replace(blocks=_carved(rough), floor=rough)


def _carved(floor: BaseGeometry) -> list[Block]:
    """Return the solids around and within a floor: an outer shell, and one block for each hole of the floor."""
    if not isinstance(floor, Polygon):
        raise WorldError("the generated floor has several pieces, expected one connected piece")
    shell = Polygon(floor.buffer(_WALL, join_style="mitre").exterior)
    blocks = [Block(name="outline", points=_corners(shell.exterior), holes=[_corners(floor.exterior)])]
    return blocks + [Block(name=f"core {k + 1}", points=_corners(hole)) for k, hole in enumerate(floor.interiors)]


def _warehouse(size: tuple[float, float], loops: int, rng: Generator) -> _Plan:
    """Place rows of racks between aisles of 2 m; a lidar sees only the uprights of the racks, and pallets."""
    del loops
    width, depth = size
    aisle, rack = 2.0, 1.0
    rows = max(1, int((depth - 2.0 * aisle + rack) / (aisle + rack)))
    aisles = [0.5 * aisle + k * (depth - aisle) / rows for k in range(rows + 1)]
    boxes = []
    for k, (low, high) in enumerate(pairwise(aisles)):
        boxes += _rack(f"rack {k + 1}", 0.5 * (low + high), width, rng)
    ends = [(x, y) for y in aisles for x in (1.1, width - 1.1)]
    graph = random_graph(len(ends), lattice_edges(2, rows + 1), len(ends), rng)
    walls = [Wall(name="outline", points=_rectangle(0.0, 0.0, width, depth), closed=True, thickness=_WALL)]
    path = _without_straight_corners([ends[k] for k in closed_walk(graph)])
    return _Plan(walls, boxes, [], path, shapely.box(_WALL, _WALL, width - _WALL, depth - _WALL))


def _rack(name: str, y: float, width: float, rng: Generator) -> list[Box]:
    """Return pairs of uprights about every 2.7 m, as in European racks, and a pallet of 1.2 m x 0.8 m in most bays."""
    margin = 2.2  # room to turn at both ends
    bays = max(1, round((width - 2.0 * margin) / 2.7))
    xs = np.linspace(margin, width - margin, bays + 1).tolist()
    boxes = [
        Box(name=f"{name} upright {k + 1}", x=x, y=y + side, width=0.1, depth=0.1)
        for k, x in enumerate(xs)
        for side in (-0.4, 0.4)
    ]
    for k, x in enumerate(xs[:-1]):
        if rng.random() < 0.6:
            at = x + float(rng.uniform(0.8, 1.9))
            boxes.append(Box(name=f"{name} pallet {k + 1}", x=at, y=y, width=1.2, depth=0.8))
    return boxes


def _rooms(size: tuple[float, float], loops: int, rng: Generator) -> _Plan:
    """Divide a rectangle into rooms, recursively, with doors between neighbours."""
    rooms = _split((0.0, 0.0, *size), rng)
    doors = {(a, b): door for a in range(len(rooms)) for b in range(a) if (door := _door(rooms[a], rooms[b], rng))}
    graph = random_graph(len(rooms), list(doors), loops, rng)
    used = {(max(edge), min(edge)) for edge in graph.tree + graph.extra}
    partitions = shapely.union_all([shapely.box(*room).boundary for room in rooms])
    walls: BaseGeometry = partitions.buffer(_WALL / 2, join_style="mitre")
    for edge in used:
        walls = walls.difference(LineString(doors[edge]).buffer(0.65, cap_style="flat"))
    blocks = [
        Block(name=f"wall {k + 1}", points=_corners(part.exterior), holes=[_corners(hole) for hole in part.interiors])
        for k, part in enumerate(shapely.get_parts(walls))
    ]
    centres = [(0.5 * (x0 + x1), 0.5 * (y0 + y1)) for x0, y0, x1, y1 in rooms]
    walk = closed_walk(graph)
    path = [centres[walk[0]]]
    for a, b in pairwise(walk):
        through = doors[max(a, b), min(a, b)]
        path += [*(through if a > b else reversed(through)), centres[b]]
    floor = shapely.union_all([shapely.box(*room).buffer(-_WALL / 2, join_style="mitre") for room in rooms])
    return _Plan([], [], blocks, _without_straight_corners(path), floor)


def _split(room: tuple[float, float, float, float], rng: Generator) -> list[tuple[float, float, float, float]]:
    """Divide a room `(x0, y0, x1, y1)` [m] into rooms with sides of at least 3 m."""
    x0, y0, x1, y1 = room
    width, depth = x1 - x0, y1 - y0
    if max(width, depth) < 6.0 or (max(width, depth) < 9.0 and rng.random() < 0.4):
        return [room]
    share = float(rng.uniform(0.4, 0.6))
    if width >= depth:
        x = x0 + max(3.0, min(width - 3.0, share * width))
        return _split((x0, y0, x, y1), rng) + _split((x, y0, x1, y1), rng)
    y = y0 + max(3.0, min(depth - 3.0, share * depth))
    return _split((x0, y0, x1, y), rng) + _split((x0, y, x1, y1), rng)


def _door(
    a: tuple[float, float, float, float], b: tuple[float, float, float, float], rng: Generator
) -> tuple[Position, Position] | None:
    """Return way points on both sides of a door from room a to room b; None if they share less than 2 m of wall."""
    low_x, high_x = max(a[0], b[0]), min(a[2], b[2])
    low_y, high_y = max(a[1], b[1]), min(a[3], b[3])
    if abs(high_x - low_x) < 1e-9 and high_y - low_y >= 2.0:
        y = float(rng.uniform(low_y + 0.9, high_y - 0.9))
        side = 0.8 if a[0] < b[0] else -0.8
        return (low_x - side, y), (low_x + side, y)
    if abs(high_y - low_y) < 1e-9 and high_x - low_x >= 2.0:
        x = float(rng.uniform(low_x + 0.9, high_x - 0.9))
        side = 0.8 if a[1] < b[1] else -0.8
        return (x, low_y - side), (x, low_y + side)
    return None


def _without_straight_corners(path: list[Position]) -> list[Position]:
    """Return the path without corners at which it goes straight on."""
    kept = path[:1]
    for here, after in pairwise(path[1:]):
        before = kept[-1]
        a: NDArray[np.float64] = np.subtract(here, before)
        b: NDArray[np.float64] = np.subtract(after, here)
        straight_on = abs(a[0] * b[1] - a[1] * b[0]) < 1e-9 and float(a @ b) > 0.0
        if not straight_on:
            kept.append(here)
    return [*kept, path[-1]]


def _corners(ring: BaseGeometry) -> list[Position]:
    """Return the corners of a ring, rounded to a tenth of a millimetre, without the repeated last one."""
    return [(round(x, 4), round(y, 4)) for x, y in shapely.get_coordinates(ring)[:-1].tolist()]


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> list[Position]:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


_PLANS: dict[Kind, Callable[[tuple[float, float], int, Generator], _Plan]] = {
    "rooms": _rooms,
    "corridors": _corridors,
    "loops": _loops,
    "blocks": _blocks,
    "maze": _maze,
    "warehouse": _warehouse,
    "cave": _cave,
}
