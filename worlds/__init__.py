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
    from worlds.format.files import catalogue, dumps, load
    from worlds.format.floor_plan import import_map, import_map_with_notes, world_from_grid
    from worlds.format.map_file import is_map, map_image
    from worlds.generate.clutter import add_clutter
    from worlds.generate.generators import KINDS, generate
    from worlds.generate.tour_planner import plan_tour
    from worlds.movers import PERSON_RADIUS, Door, Person
    from worlds.raster import TrueMap, true_map
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
    "generate",
    "import_map",
    "import_map_with_notes",
    "is_map",
    "load",
    "map_image",
    "measure_difficulty",
    "plan_tour",
    "true_map",
    "world_from_grid",
]

_HOMES = {
    "KINDS": "worlds.generate.generators",
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
    "add_clutter": "worlds.generate.clutter",
    "catalogue": "worlds.format.files",
    "check_world": "worlds.check",
    "dumps": "worlds.format.files",
    "generate": "worlds.generate.generators",
    "import_map": "worlds.format.floor_plan",
    "import_map_with_notes": "worlds.format.floor_plan",
    "is_map": "worlds.format.map_file",
    "load": "worlds.format.files",
    "map_image": "worlds.format.map_file",
    "measure_difficulty": "worlds.difficulty",
    "plan_tour": "worlds.generate.tour_planner",
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
