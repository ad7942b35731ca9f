# SPDX-License-Identifier: MIT
"""Compiling the simulator's kernels ahead of their first use."""

from __future__ import annotations

from testbed.simulation.config import SimulationConfig
from testbed.simulation.simulator import simulate
from worlds import Door, Person, Start, Tour, Wall, World


def warm_up() -> None:
    """Run a quarter of a second in a small room with everything in it that a kernel is for.

    Takes about 15 s on a machine that has not compiled them yet, and a moment on one that has.
    """
    room = World(
        name="warm-up",
        start=Start(x=1.0, y=1.0),
        tour=Tour(points=[(5.0, 1.0)]),
        walls=[Wall(name="walls", points=[(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)], closed=True)],
        people=[Person(name="person", points=[(1.0, 4.0), (5.0, 4.0)])],
        doors=[Door(name="door", x=3.0, y=5.9, closed=0.0, swing=1.5)],
    )
    for _ in simulate(room, SimulationConfig(backend="fast", duration=0.25)):
        pass
