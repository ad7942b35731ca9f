# SPDX-License-Identifier: MIT
"""What a place is: walls, blocks, start and tour, in TOML files; and the true map drawn from the same geometry."""

from worlds.check import check_world
from worlds.difficulty import measure_difficulty
from worlds.elements import Block, Box, Disc, Opening, Wall
from worlds.errors import WorldError
from worlds.format.files import catalogue, dumps
from worlds.format.floor_plan import import_map, is_map, map_image, world_from_grid
from worlds.generate.clutter import add_clutter
from worlds.generate.generators import KINDS, generate
from worlds.generate.tour_planner import plan_tour
from worlds.movers import PERSON_RADIUS, Door, Person
from worlds.names import expand_names, family, label, load
from worlds.raster import TrueMap, true_map
from worlds.routes import random_route
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
    "is_map",
    "label",
    "load",
    "map_image",
    "measure_difficulty",
    "plan_tour",
    "random_route",
    "true_map",
    "world_from_grid",
]
