# SPDX-License-Identifier: MIT
"""The report's pictures show what the maps hold: the right way up, in the right colours."""

import numpy as np

from eval.report.map_images import INVENTED, MISSING, RIGHT, SEEN, UNSEEN, draw_difference, draw_map, frame_around
from slam.occupancy import OccupancyGrid
from tests.eval.helpers import moved, room, with_wall

IDENTITY = np.zeros(3)


def grid(probability) -> OccupancyGrid:
    return OccupancyGrid(probability=np.asarray(probability, np.float32), resolution=0.5, origin=(1.0, 2.0, 0.0))


def rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))


def test_the_highest_y_is_the_top_row_of_a_map():
    picture = draw_map(grid([[1.0, 0.0], [np.nan, 0.0]]), grid(np.full((2, 2), np.nan)), IDENTITY)
    assert picture.extent == (1.0, 2.0, 2.0, 3.0)
    assert [[tuple(pixel) for pixel in row] for row in picture.pixels.tolist()] == [
        [rgb(UNSEEN), rgb(SEEN)],
        [rgb(RIGHT), rgb(SEEN)],
    ]


def test_each_kind_of_difference_has_its_colour():
    truth = with_wall(room(), slice(20, 100), 60)
    found = with_wall(with_wall(room(), slice(20, 100), 100), slice(20, 100), slice(25, 30), np.nan)
    pixels = np.flipud(draw_difference(found, truth, truth, IDENTITY).pixels)
    assert tuple(pixels[50, 60]) == rgb(MISSING)
    assert tuple(pixels[50, 100]) == rgb(INVENTED)
    assert tuple(pixels[50, 19]) == rgb(RIGHT)
    assert tuple(pixels[50, 80]) == rgb(SEEN)
    assert tuple(pixels[50, 27]) == rgb(UNSEEN)


def test_one_cell_off_is_right_and_unexplored_is_not_missing():
    truth = with_wall(room(), slice(20, 100), 60)
    off_by_one = with_wall(room(), slice(20, 100), 61)
    pixels = np.flipud(draw_difference(off_by_one, truth, truth, IDENTITY).pixels)
    assert tuple(pixels[50, 61]) == rgb(RIGHT)
    unexplored = with_wall(room(), slice(20, 100), slice(50, 70), np.nan)
    pixels = np.flipud(draw_difference(unexplored, truth, truth, IDENTITY).pixels)
    assert tuple(pixels[50, 60]) == rgb(UNSEEN)


def test_the_frame_holds_the_map_wherever_it_lies_but_not_a_stray_beam():
    T = np.array([10.0, 5.0, 0.5])
    frame = frame_around(room(), T, [], 0.5)
    again = draw_map(room(), frame, T)
    walls = (again.pixels == rgb(RIGHT)).all(axis=2)
    assert 300 < walls.sum() < 700
    assert not walls[[0, -1]].any()
    assert not walls[:, [0, -1]].any()
    wide = np.full((120, 2000), np.nan, np.float32)
    wide[:, :160] = room().probability
    wide[60, 1900] = 0.0
    stray = frame_around(OccupancyGrid(probability=wide, resolution=0.05, origin=(-1.0, -1.0, 0.0)), IDENTITY, [], 0.5)
    assert stray.probability.shape[1] < 200


def test_a_map_of_any_size_gives_a_picture_of_bounded_size():
    huge = moved(
        OccupancyGrid(probability=np.zeros((10, 5000), np.float32), resolution=0.05, origin=(0, 0, 0)), (0, 0, 1)
    )
    assert max(frame_around(huge, IDENTITY, [], 0.5).probability.shape) <= 1400
