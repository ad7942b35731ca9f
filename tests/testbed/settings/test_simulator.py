# SPDX-License-Identifier: MIT
"""Loading a world by the settings of the simulator: clutter and routes."""

import shapely

from testbed.seeds import RunSeeds
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation import DriverConfig


def path_of(seed: int, world: str = "office", **options: object) -> shapely.LineString:
    return shapely.LineString(SimulatorOptions(**options).load_world(world, RunSeeds.from_seed(seed)).path())


def test_fixed_routes_are_equal_for_all_seeds_and_random_ones_differ():
    assert path_of(1) == path_of(2)
    assert path_of(1, route="random") == path_of(1, route="random")
    assert path_of(1, route="random") != path_of(2, route="random")
    assert shapely.hausdorff_distance(path_of(1, route="random"), path_of(1)) < 0.01


def test_clutter_is_the_same_for_all_routes_and_leaves_them_free():
    worlds = [SimulatorOptions(route="random", clutter=1.0).load_world("loop", RunSeeds.from_seed(s)) for s in (1, 2)]
    assert worlds[0].boxes == worlds[1].boxes
    assert len(worlds[0].boxes) > 0
    for world in worlds:
        assert shapely.LineString(world.path()).distance(world.cross_section()) > 0.2


def test_only_tours_are_drawn():
    explored = SimulatorOptions(route="random", driver=DriverConfig(kind="explore"))
    assert explored.load_world("office", RunSeeds.from_seed(1)) == SimulatorOptions().load_world(
        "office", RunSeeds.from_seed(2)
    )
