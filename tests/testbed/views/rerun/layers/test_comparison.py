# SPDX-License-Identifier: MIT
"""Which particles are compared, and what their maps look like."""

from __future__ import annotations

import numpy as np

from testbed.views.map_cells import UNKNOWN, MapCells
from testbed.views.rerun.layers.comparison import most_different
from testbed.views.rerun.layers.map_tiles import SQUARE, ImagePool, MapTiles

SIDE = 16


def cells_of(tables: np.ndarray, words: np.ndarray, particle: int = 0) -> MapCells:
    """Maps whose tiles hold grey levels as counts words; cells below 100 are walls."""
    walls = ((words < 100).reshape(-1, SIDE, SIDE) << np.arange(SIDE)).sum(axis=2).astype(np.uint16)
    return MapCells(
        table=tables[particle],
        tiles=words.astype(np.uint16),
        corner=(0, 0),
        cell=0.05,
        touched=np.ones(tables.shape[1:], np.int64),
        scans=1,
        grey=np.arange(1 << 16).clip(max=255).astype(np.uint8),
        tables=tables,
        walls=walls,
    )


def test_the_two_maps_with_the_most_different_walls_are_found() -> None:
    words = np.full((4, SIDE * SIDE), UNKNOWN)
    words[2, :3], words[3, 10:90] = 0, 0
    tables = np.zeros((4, 4, 4), np.int32)
    tables[:, 0, 0] = 1, 2, 3, 1
    for best in range(4):
        assert 2 in most_different(cells_of(tables, words), best)
    assert set(most_different(cells_of(tables, words), 0)) != {2}


def test_a_coarse_pixel_is_the_darkest_of_its_cells_that_were_seen() -> None:
    words = np.full((2, SIDE, SIDE), UNKNOWN)
    words[1, :2, :2] = [[255, 7], [UNKNOWN, 230]]  # a wall among free cells
    words[1, :2, 2:4] = [[255, UNKNOWN], [UNKNOWN, UNKNOWN]]  # one cell seen
    cells = cells_of(np.ones((1, 1, 1), np.int32), words.reshape(2, -1))
    (square,) = MapTiles(ImagePool(1), coarse=2).changes(cells, everything=True)
    assert square.image[SQUARE - 1, :3].tolist() == [7, 255, UNKNOWN]  # row 0 of the image is at the highest y
    assert np.count_nonzero(square.image != UNKNOWN) == 2


def test_an_image_lasts_until_the_pool_is_cleared() -> None:
    pool = ImagePool(2)
    images = [np.full((SQUARE, SQUARE), grey, np.uint8) for grey in (1, 2, 3)]
    copies = [pool.copy_of(image) for image in images]
    assert pool.full
    for image, copy in zip(images, copies, strict=True):
        np.testing.assert_array_equal(copy, image)
    pool.clear()
    assert not pool.full
