# SPDX-License-Identifier: MIT
"""Worlds: walls, blocks, start and tour, in TOML files; and the true map, drawn from the same geometry."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from worlds.check import check_world
    from worlds.difficulty import measure_difficulty
    from worlds.elements import Block, Box, Disc, Opening, Wall
    from worlds.errors import WorldError
    from worlds.format.files import catalogue, dumps
    from worlds.format.floor_plan import import_map, import_map_with_notes, world_from_grid
    from worlds.format.map_file import is_map, map_image
    from worlds.generation.clutter import add_clutter
    from worlds.generation.generators import KINDS, generate
    from worlds.generation.tour_planner import plan_tour
    from worlds.movers import PERSON_RADIUS, Door, Person
    from worlds.names import expand_names, family, label, load
    from worlds.raster import TrueMap, true_map
    from worlds.routes.random_route import random_route
    from worlds.routes.stops_route import stops_route
    from worlds.world import Difficulty, Start, Tour, World

__all__ = [
    "KINDS",
    "PERSON_RADIUS",
    "Block",
    "Box",
    "Difficulty",
    "Disc",
    "Door",
    "Opening",
    "Person",
    "Start",
    "Tour",
    "TrueMap",
    "Wall",
    "World",
    "WorldError",
    "add_clutter",
    "catalogue",
    "check_world",
    "dumps",
    "expand_names",
    "family",
    "generate",
    "import_map",
    "import_map_with_notes",
    "is_map",
    "label",
    "load",
    "map_image",
    "measure_difficulty",
    "plan_tour",
    "random_route",
    "stops_route",
    "true_map",
    "world_from_grid",
]

_HOMES = {
    "KINDS": "worlds.generation.generators",
    "PERSON_RADIUS": "worlds.movers",
    "Block": "worlds.elements",
    "Box": "worlds.elements",
    "Difficulty": "worlds.world",
    "Disc": "worlds.elements",
    "Door": "worlds.movers",
    "Opening": "worlds.elements",
    "Person": "worlds.movers",
    "Start": "worlds.world",
    "Tour": "worlds.world",
    "TrueMap": "worlds.raster",
    "Wall": "worlds.elements",
    "World": "worlds.world",
    "WorldError": "worlds.errors",
    "add_clutter": "worlds.generation.clutter",
    "catalogue": "worlds.format.files",
    "check_world": "worlds.check",
    "dumps": "worlds.format.files",
    "expand_names": "worlds.names",
    "family": "worlds.names",
    "generate": "worlds.generation.generators",
    "import_map": "worlds.format.floor_plan",
    "import_map_with_notes": "worlds.format.floor_plan",
    "is_map": "worlds.format.map_file",
    "label": "worlds.names",
    "load": "worlds.names",
    "map_image": "worlds.format.map_file",
    "measure_difficulty": "worlds.difficulty",
    "plan_tour": "worlds.generation.tour_planner",
    "random_route": "worlds.routes.random_route",
    "stops_route": "worlds.routes.stops_route",
    "true_map": "worlds.raster",
    "world_from_grid": "worlds.format.floor_plan",
}


def __getattr__(name: str) -> object:
    """Load public names on first use: reading a map file must not load the geometry library (0.4 s, 40 MB)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'worlds' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value
