# SPDX-License-Identifier: MIT
"""Greys that do not mean what the thresholds say: lossy pictures, rtabmap, hector_geotiff, pictures inside out."""

import numpy as np
import pytest
from PIL import Image

from tests.worlds.format.plans import FREE, UNKNOWN, WALL, p5, plan, write
from worlds.format.map_file import read_map_file

PLAN = plan()
CELLS = np.select([PLAN == WALL, PLAN == FREE], [1.0, 0.0], np.nan)[::-1]


def as_grey(wall, free, unknown):
    return np.select([PLAN == WALL, PLAN == FREE], [wall, free], unknown).astype(np.uint8)


def share_right(file):
    unknown = np.isnan(file.probability) & np.isnan(CELLS)
    return float(np.mean((file.probability == CELLS) | unknown))


@pytest.mark.parametrize("quality", [50, 75, 95])
@pytest.mark.parametrize("free_thresh", [0.196, 0.25])
def test_a_lossy_picture_keeps_its_unknown_cells(tmp_path, quality, free_thresh):
    Image.fromarray(PLAN).save(tmp_path / "map.jpg", quality=quality)
    path = write(tmp_path, (tmp_path / "map.jpg").read_bytes(), "map.jpg", free_thresh=free_thresh)
    file = read_map_file(path)
    assert share_right(file) > 0.998
    assert "greys 193 to 217 are read as unknown" in file.notes[0]


def test_a_grey_ramp_in_a_lossy_picture_is_no_mark(tmp_path):
    ramp = np.tile(np.linspace(0, 255, 256).astype(np.uint8), (64, 1))
    Image.fromarray(ramp).save(tmp_path / "map.jpg", quality=95)
    file = read_map_file(write(tmp_path, (tmp_path / "map.jpg").read_bytes(), "map.jpg", free_thresh=0.25))
    assert file.notes == ()
    assert (file.probability[:, 200:] == 0.0).all()


def test_rtabmaps_greys_are_read_as_it_means_them(tmp_path):
    picture = as_grey(0, 178, 89)
    picture[60:70, 20:40] = 200  # free, seen once only
    file = read_map_file(write(tmp_path, p5(picture)))
    assert share_right(file) == 1.0
    assert "as rtabmap writes them" in file.notes[0]


@pytest.mark.parametrize("change", [{"negate": 1}, {"grey": 120}])
def test_its_greys_among_others_or_negated_are_not(tmp_path, change):
    picture = as_grey(0, 178, 89)
    picture[0, 0] = change.pop("grey", 89)
    file = read_map_file(write(tmp_path, p5(picture), **change))
    assert not any("rtabmap" in note for note in file.notes)


def test_hectors_board_is_unknown(tmp_path):
    board = np.indices(PLAN.shape).sum(0) // 8 % 2 == 0
    colours = np.array([[0, 40, 120], [255, 255, 255], [226, 226, 227], [237, 237, 238]], np.uint8)
    kinds = np.select([PLAN == WALL, PLAN == FREE, board], [0, 1, 2], 3)
    file = read_map_file(write(tmp_path, Image.fromarray(colours[kinds]), "map.tif"))
    assert share_right(file) == 1.0
    assert "greys 226 and 237 are read as unknown" in file.notes[0]


@pytest.mark.parametrize("picture", [255 - PLAN, as_grey(100, 0, 255), as_grey(20, 190, 128)])
def test_a_map_that_is_mostly_occupied_is_questioned(tmp_path, picture):
    (note,) = read_map_file(write(tmp_path, p5(picture))).notes
    assert "of the known cells are occupied: are negate, mode" in note


def test_eight_bits_saved_as_sixteen_are_read(tmp_path):
    head = b"P5\n%d %d\n65535\n" % PLAN.shape[::-1]
    file = read_map_file(write(tmp_path, head + PLAN.astype(">u2").tobytes()))
    assert share_right(file) == 1.0
    assert UNKNOWN in PLAN


def test_greys_read_as_raw_percents_are_questioned(tmp_path):
    """0 is black, a wall, but as a percentage it is free."""
    file = read_map_file(write(tmp_path, p5(PLAN), mode="raw"))
    assert "no known cell is occupied" in file.notes[0]
