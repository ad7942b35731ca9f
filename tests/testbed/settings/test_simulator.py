# SPDX-License-Identifier: MIT
"""Loading a world by the settings of the simulator: clutter and routes."""

import math
import os

import numpy as np
import pytest
import shapely

import worlds
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
    found = [SimulatorOptions(route="random", clutter=1.0).load_world("loop", RunSeeds.from_seed(s)) for s in (1, 2)]
    assert found[0].boxes == found[1].boxes
    assert len(found[0].boxes) > 0
    for world in found:
        assert shapely.LineString(world.path()).distance(world.cross_section()) > 0.2


def test_only_tours_are_drawn():
    explored = SimulatorOptions(route="random", driver=DriverConfig(kind="explore"))
    assert explored.load_world("office", RunSeeds.from_seed(1)) == SimulatorOptions().load_world(
        "office", RunSeeds.from_seed(2)
    )


@pytest.mark.parametrize("route", ["fixed", "stops"])
def test_a_start_is_where_the_drive_begins(route):
    options = SimulatorOptions(start="2,2,90", route=route)
    for seed in range(2):
        world = options.load_world("office", RunSeeds.from_seed(seed))
        assert (world.start.x, world.start.y) == (2.0, 2.0)
        assert world.start.theta == pytest.approx(math.pi / 2.0)
        worlds.check_world(world, footprint_radius=0.22)
        assert np.ptp(world.path(), axis=0).min() > 5.0


def test_a_start_is_in_the_frame_of_the_map(tmp_path):
    free = np.zeros((80, 80), dtype=np.uint8)
    free[1:-1, 1:-1] = 254
    (tmp_path / "plan.pgm").write_bytes(b"P5 80 80 255\n" + free.tobytes())
    (tmp_path / "plan.yaml").write_text(
        "image: plan.pgm\nresolution: 0.1\norigin: [500000, 4000000, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    world = SimulatorOptions(start="500002,4000003,0").load_world(str(tmp_path / "plan.yaml"), RunSeeds.from_seed(0))
    assert (world.start.x, world.start.y) == (pytest.approx(2.0), pytest.approx(3.0))
    assert world.offset == (500000.0, 4000000.0)


@pytest.mark.parametrize(
    ("start", "route", "complaint"),
    [
        ("1,2", "fixed", "expected X,Y,DEG"),
        ("2,2,90", "random", "expected fixed or stops"),
        ("0,0,0", "fixed", "expected a free place"),
        ("200,0,0", "stops", "expected walls that leave no way out"),
    ],
)
def test_a_start_that_makes_no_sense_is_refused(start, route, complaint):
    with pytest.raises(ValueError, match=complaint):
        SimulatorOptions(start=start, route=route).load_world("office", RunSeeds.from_seed(0))


def test_a_world_file_that_changed_is_read_again(tmp_path):
    file = tmp_path / "place.toml"
    for size in (10, 16):
        corners = [[0, 0], [size, 0], [size, size], [0, size]]
        file.write_text(f"name = 'place'\n[start]\nx = 2\ny = 2\n[[walls]]\npoints = {corners}\nclosed = true\n")
        os.utime(file, ns=(size, size))
        first, second = (SimulatorOptions().load_world(str(file), RunSeeds.from_seed(s)) for s in (0, 1))
        assert first is second  # nothing is planned twice
        assert first.cross_section().bounds[2] == pytest.approx(size, abs=0.2)
