# SPDX-License-Identifier: MIT
"""A room that is driven through in a few seconds, and small sweeps of it."""

from pathlib import Path

from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import file_digest
from worlds import Start, Tour, Wall, World, dumps


def room_file(folder: Path, name: str = "room", width: float = 5.0) -> Path:
    """A world file: a room with a pillar, and a tour of 2 m."""
    outside = [(0.0, 0.0), (width, 0.0), (width, 4.0), (0.0, 4.0)]
    pillar = [(2.0, 3.0), (2.5, 3.0), (2.5, 3.5), (2.0, 3.5)]
    world = World(
        name=name,
        start=Start(x=1.0, y=1.0),
        tour=Tour(points=[(3.0, 1.5)]),
        walls=[Wall(name="walls", points=outside, closed=True), Wall(name="pillar", points=pillar, closed=True)],
    )
    path = folder / f"{name}.toml"
    path.write_text(dumps(world), encoding="utf-8")
    return path


def room_cell(world: Path, **changes: object) -> Cell:
    """A cell that maps the room with two particles."""
    fields: dict = {
        "place": world.stem,
        "source": {"world": str(world)},
        "line": "default",
        "settings": {"refine": False},
        "particles": 2,
        "seed": 0,
        "inputs": {str(world): file_digest(world)},
        "code": code_version(),
    }
    return Cell(**(fields | changes))
