# SPDX-License-Identifier: MIT
"""Worlds whose sizes look like centimetres are questioned, those of the catalogue are not."""

import pytest

import worlds
from worlds.check import unit_notes


@pytest.mark.parametrize("name", worlds.catalogue())
def test_worlds_of_the_catalogue_are_in_metres(name):
    assert unit_notes(worlds.load(name)) == ()


def hall(scale, thickness, **settings):
    corners = [(0.0, 0.0), (8.0 * scale, 0.0), (8.0 * scale, 6.0 * scale), (0.0, 6.0 * scale)]
    wall = worlds.Wall(points=corners, closed=True, thickness=thickness, **settings)
    return worlds.World(name="hall", start=worlds.Start(x=4.0 * scale, y=3.0 * scale), walls=[wall])


def test_a_world_in_centimetres_is_questioned():
    assert unit_notes(hall(1.0, 0.1)) == ()
    assert unit_notes(hall(100.0, 10.0)) == ("world 'hall' of 810 x 610 m has walls 10 m thick: is it in centimetres?",)
    doors = [worlds.Opening(at=300.0, width=95.0)]
    assert "openings 95 m wide" in unit_notes(hall(100.0, 0.0, openings=doors))[0]
