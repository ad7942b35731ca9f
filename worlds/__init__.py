# SPDX-License-Identifier: MIT
"""What a place is: walls, blocks, start and tour, in TOML files; and the true map drawn from the same geometry."""

from worlds.check import check_world
from worlds.elements import Block, Box, Disc, Opening, Wall
from worlds.errors import WorldError
from worlds.files import catalogue, load
from worlds.movers import PERSON_RADIUS, Door, Person
from worlds.raster import TrueMap, true_map
from worlds.world import Start, Tour, World

__all__ = [
    "PERSON_RADIUS",
    "Block",
    "Box",
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
    "catalogue",
    "check_world",
    "load",
    "true_map",
]
