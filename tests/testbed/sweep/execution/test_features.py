# SPDX-License-Identifier: MIT
"""Features of worlds of known shape."""

import pytest

from testbed.simulation import SimulationConfig
from testbed.sweep.execution.features import clutter, features_of, largest_loop, unknown_stretch
from worlds import Box, Disc, Start, Tour, Wall, World, load


def ring(side: float, width: float = 2.0, laps: int = 1) -> World:
    """A square corridor round a block of this side [m], driven along its middle."""
    far, middle = side + 2.0 * width, 0.5 * width
    outside = Wall(name="out", points=[(0.0, 0.0), (far, 0.0), (far, far), (0.0, far)], closed=True)
    block = Box(name="block", x=0.5 * far, y=0.5 * far, width=side, depth=side)
    corners = [(far - middle, middle), (far - middle, far - middle), (middle, far - middle), (middle, middle)]
    return World(
        name="ring", start=Start(x=middle, y=middle), walls=[outside], boxes=[block], tour=Tour(points=corners * laps)
    )


@pytest.mark.parametrize("side", [8.0, 20.0])
def test_the_loop_of_a_ring_is_its_inner_outline(side):
    assert largest_loop(ring(side)) == pytest.approx(4.0 * side)


@pytest.mark.parametrize("laps", [1, 3])
def test_a_ring_is_unknown_for_one_lap_whatever_the_number_of_laps(laps):
    assert unknown_stretch(ring(20.0, laps=laps)) == pytest.approx(4.0 * 22.0 - 2.0, abs=1.0)


def test_the_way_back_is_known():
    out = Wall(name="out", points=[(0.0, 0.0), (40.0, 0.0), (40.0, 2.0), (0.0, 2.0)], closed=True)
    corridor = World(name="c", start=Start(x=1.0, y=1.0), walls=[out], tour=Tour(points=[(39.0, 1.0), (1.0, 1.0)]))
    assert largest_loop(corridor) == 0.0
    assert unknown_stretch(corridor) == pytest.approx(39.0, abs=1.0)  # one metre behind the turn it is known


def test_clutter_counts_small_things_per_floor():
    world = ring(8.0)
    furnished = world.model_copy(
        update={
            "boxes": [*world.boxes, Box(name="chair", x=1.0, y=5.0, width=0.4, depth=0.4)],
            "discs": [Disc(name="bin", x=5.0, y=1.0, radius=0.2)],
        }
    )
    assert clutter(world, 80.0) == 0.0
    assert clutter(furnished, 80.0) == pytest.approx(0.25)


def test_features_are_plain_numbers_of_world_and_sensors():
    features = features_of(load("loop"), SimulationConfig())
    assert all(type(value) in (int, float, str) for value in features.values())
    assert features["determined_share"] == pytest.approx(1.0 - features["corridor_share"])
    assert features["lidar_range_m"] == SimulationConfig().lidar.range_max
    assert features["route_m"] > features["unknown_stretch_m"] > 20.0
