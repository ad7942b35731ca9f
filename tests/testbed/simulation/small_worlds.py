# SPDX-License-Identifier: MIT
"""Small worlds and perfect sensors for tests of the simulator."""

import numpy as np

from testbed.simulation import LidarLayers, OdometryConfig, SimulationConfig
from worlds import Box, Disc, Start, Tour, Wall, World

PERFECT_ODOMETRY = OdometryConfig(systematic=False, random=False, ticks=False)


def room(start=(0.0, 0.0, 0.0), tour=((3.0, 0.0),), half=5.0, **elements):
    """A square room of side 2 half [m] about the origin."""
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    return World(
        name="room",
        start=Start(x=start[0], y=start[1], theta=start[2]),
        tour=Tour(points=list(tour)),
        walls=[Wall(name="outline", points=corners, closed=True)],
        **elements,
    )


def perfect(**settings):
    """A simulation without any error of the sensors."""
    return SimulationConfig(lidar_layers=LidarLayers.none(), odometry=PERFECT_ODOMETRY, **settings)


def random_world(rng, blocks=40, half=10.0):
    """A room with blocks at random places, none of them within 1 m of the origin."""
    boxes, discs = [], []
    while len(boxes) + len(discs) < blocks:
        x, y = rng.uniform(-half, half, 2)
        if np.hypot(x, y) < 2.5:
            continue
        if rng.random() < 0.7:
            width, depth = rng.uniform(0.1, 2.0, 2)
            boxes.append(Box(x=x, y=y, width=width, depth=depth, rotation=rng.uniform(-3.0, 3.0)))
        else:
            discs.append(Disc(x=x, y=y, radius=rng.uniform(0.05, 0.8)))
    return room(half=half, boxes=boxes, discs=discs)
