# SPDX-License-Identifier: MIT
"""Things put up in a world leave its drive alone."""

import pytest
import shapely
from shapely.geometry import LineString

from worlds import WorldError, add_clutter, check_world, load


@pytest.mark.parametrize("name", ["office", "concourse", "museum"])
def test_a_higher_density_keeps_objects_and_adds_more(name):
    world = load(name)
    some, more = (add_clutter(world, density, clearance=0.4) for density in (0.5, 2.0))
    check_world(more, footprint_radius=0.3)
    assert (more.tour, more.start) == (world.tour, world.start)
    assert len(some.elements) > len(world.elements)
    added = [element for element in more.elements if element not in world.elements]
    assert all(element in added for element in some.elements if element not in world.elements)
    drive = LineString(world.path())
    assert min(element.shape().distance(drive) for element in added) >= 0.4
    floor = world.free_space()
    assert 0.3 * 0.2 * floor.area < len(added) <= 0.2 * floor.area + 1
    assert all(shapely.dwithin(floor, element.shape(), 1e-6) for element in added)


def test_bad_densities_are_refused():
    with pytest.raises(WorldError, match="expected 0 to 20"):
        add_clutter(load("loop"), -1.0, clearance=0.4)
