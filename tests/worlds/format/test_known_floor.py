# SPDX-License-Identifier: MIT
"""The floor of a building: inside of its walls, known, connected; what is left out is said with its area."""

import subprocess
import sys

import numpy as np
import pytest

import worlds
from tests.worlds.format.plans import CELL, FLOOR, FREE, UNKNOWN, WALL, p5, plan, write
from worlds.errors import WorldError
from worlds.format.known_floor import find_floor


def floor_of(picture):
    """The floor on a picture of grey values, top row first as in the picture."""
    return find_floor(picture == FREE, picture == UNKNOWN, CELL)


def area(floor):
    return floor.free.sum() * CELL**2


def on_paper(margin=100):
    """The plan drawn on white paper."""
    picture = plan(margin)
    picture[picture == UNKNOWN] = FREE
    return picture


def test_a_plan_on_unknown_ground_is_its_own_floor():
    floor = floor_of(plan())
    np.testing.assert_array_equal(floor.free, plan() == FREE)
    assert floor.notes == ()


def test_the_start_is_farthest_from_everything_solid():
    floor = floor_of(plan())
    row, col = floor.start
    assert plan()[row - 30 : row + 31, col - 30 : col + 31].min() == FREE  # 1.5 m to all sides


def test_a_white_margin_is_left_out_and_said():
    floor = floor_of(on_paper())
    assert area(floor) == pytest.approx(FLOOR)
    outside = (on_paper() == FREE).sum() * CELL**2 - FLOOR
    assert floor.notes[0] == f"{outside:.0f} m² of free cells outside of the walls are left out, like a white margin"


def test_a_leak_to_the_outside_is_closed_and_said():
    picture = on_paper()
    picture[140:160, 100:102] = FREE  # a gap of 1 m in the outer wall
    floor = floor_of(picture)
    assert area(floor) == pytest.approx(FLOOR, abs=0.3)
    assert "of floor are open towards the outside: the gap in the walls is closed" in floor.notes[1]
    assert floor.free[floor.start]


def test_a_small_building_on_a_large_page_is_said():
    floor = floor_of(plan(500))
    assert floor.notes == (f"the floor covers 44 m² of a page of {1120 * 1160 * CELL**2:.0f} m²",)


def test_a_page_without_a_building_is_all_floor():
    picture = np.full((100, 100), FREE, np.uint8)
    picture[40:44, 40:44] = WALL
    assert area(floor_of(picture)) == pytest.approx((picture == FREE).sum() * CELL**2)


def test_the_start_is_where_most_of_the_floor_can_be_reached():
    picture = np.full((100, 300), WALL, np.uint8)
    picture[10:90, 10:90] = FREE  # a hall of 16 m², the roomiest place of all
    for left in range(100, 290, 30):
        picture[20:80, left : left + 28] = FREE
    picture[40:60, 100:290] = FREE  # rooms with doors, 28 m²
    floor = floor_of(picture)
    assert floor.start[1] >= 100
    assert floor.notes == ("16.0 m² of floor are not connected with the start",)


def test_unknown_specks_are_floor_and_unknown_areas_are_not():
    picture = plan()
    picture[20:24, 20:24] = UNKNOWN
    picture[90:110, 20:40] = UNKNOWN  # 1 m²
    assert area(floor_of(picture)) == pytest.approx(FLOOR - 1.0)


def test_no_free_cell_is_an_error_that_names_the_file(tmp_path):
    path = write(tmp_path, p5(np.full((9, 9), UNKNOWN)))
    with pytest.raises(WorldError, match=r"map\.yaml: no free cell"):
        worlds.import_map(path)


@pytest.mark.parametrize("margin", [10, 60])
def test_tours_of_imported_maps_stay_on_known_floor(tmp_path, margin):
    picture = on_paper(margin)
    picture[: margin // 2] = UNKNOWN
    world = worlds.import_map(write(tmp_path, p5(picture)))
    tour = worlds.plan_tour(world, footprint_radius=0.2).path()
    cells = np.floor((tour - [-4.5, -3.5]) / CELL).astype(int)
    inside = np.flipud(plan(margin)) == FREE
    assert inside[cells[:, 1], cells[:, 0]].all()
    assert len(np.unique(tour[:, 0] > -4.5 + (margin + 80) * CELL)) == 2  # it visits both rooms


@pytest.mark.slow
def test_sixteen_million_cells_are_imported_in_a_gigabyte(tmp_path):
    path = write(tmp_path, p5(plan(1920)[:4000, :4000]), free_thresh=0.25)
    code = f"""
import resource, worlds
print(worlds.import_map({str(path)!r}).free_space().area)
peak = next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(resource.getrusage(resource.RUSAGE_SELF).ru_utime, peak)  # ru_maxrss would count the tests' own process
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    area, seconds, kilobytes = map(float, done.stdout.split())
    assert area == pytest.approx(FLOOR)
    assert seconds < 10.0
    assert kilobytes < 1e6
