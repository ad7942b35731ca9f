# SPDX-License-Identifier: MIT
"""Which cells are walls: where enough beams end, and as many as in the cells beside them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.config import MatchConfig
from slam.grid._cell_kernels import HIT_SHIFT
from slam.grid._tile_kernels import SIDE
from slam.grid._wall_kernels import is_wall
from slam.matching.likelihood import log_likelihoods, make_beam_model
from slam.sensor.rays import make_rays
from tests.slam.rooms import empty_maps, rays, scan_at

TABLE = np.ones((1, 1), np.int32)


def is_wall_among(hits, passes=None):
    """Whether the middle cell of `hits` (3, 3) is a wall, `passes` (3, 3) more beams having gone through each."""
    hits = np.asarray(hits)
    visits = hits if passes is None else hits + np.asarray(passes)
    counts = np.zeros((2, SIDE, SIDE), np.uint16)
    counts[1, 4:7, 8:11] = (hits << int(HIT_SHIFT)) | visits
    return is_wall(TABLE, counts.reshape(2, -1), 9, 5, 0.25)


@pytest.mark.parametrize(("middle", "wall"), [(10, True), (9, False), (5, False), (1, False)])
@pytest.mark.parametrize("turns", range(4))
def test_a_cell_behind_a_wall_is_none(middle, wall, turns):
    """A cell beside a straight wall, with fewer hits; it is the same for walls in all four directions."""
    hits = [[0, 0, 0], [middle, middle, middle], [10, 10, 10]]
    assert is_wall_among(np.rot90(hits, turns)) == wall


@pytest.mark.parametrize("turns", range(2))
@pytest.mark.parametrize("hits", [[[0, 0, 0], [10, 2, 10], [0, 0, 0]], [[10, 0, 0], [0, 2, 0], [0, 0, 10]]])
def test_a_cell_of_a_wall_may_have_been_seen_less_than_its_neighbours(hits, turns):
    assert is_wall_among(np.rot90(hits, turns))


def test_a_cell_needs_its_share_of_hits_too():
    passes = np.zeros((3, 3), int)
    passes[1, 1] = 7
    assert not is_wall_among([[0, 0, 0], [2, 2, 2], [0, 0, 0]], passes)
    passes[1, 1] = 6
    assert is_wall_among([[0, 0, 0], [2, 2, 2], [0, 0, 0]], passes)


def test_a_wall_stays_where_it_is_when_its_counts_are_full():
    """Four beams end in a wall of three cells for three in the cells behind it, a thousand times in all."""
    maps = empty_maps()
    rows = np.array([-0.075, -0.025, 0.025])
    wall, behind = (np.column_stack([np.full(3, x), rows]) for x in (5.025, 5.075))
    maps.integrate_scan(np.zeros((1, 3)), rays(np.vstack([wall, behind])))
    for _ in range(150):
        maps.integrate_scan(np.zeros((1, 3)), rays(np.vstack([wall] * 4 + [behind] * 3)))
        grids = maps.grids
        cells = [np.floor(ends[1] / 0.05).astype(int) - grids.corner for ends in (wall, behind)]
        assert [bool(is_wall(grids.table[0], grids.counts, *cell, 0.25)) for cell in cells] == [True, False]


@given(st.lists(st.integers(0, 127), min_size=9, max_size=9), st.integers(0, 3), st.booleans())
@settings(deadline=None)
def test_walls_are_the_same_from_all_sides(hits, turns, mirrored):
    square = np.reshape(hits, (3, 3))
    turned = np.rot90(square[:, ::-1] if mirrored else square, turns)
    assert is_wall_among(square) == is_wall_among(turned)


@pytest.mark.parametrize(("noise", "most"), [(0.01, 0.003), (0.03, 0.005), (0.05, 0.01)])
def test_walls_are_no_farther_than_they_are(noise, most):
    """In a closed room walls too far out make scans fit best whose ranges are all too long: by 0.3, 1.5 and 3 cm with
    the noise of these cases [m] where the share of hits alone makes a wall."""
    rng = np.random.default_rng(5)
    maps, model = empty_maps(), make_beam_model(MatchConfig(), empty_maps().config)

    def scans(count):
        poses = np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), rng.uniform(-np.pi, np.pi, count)])
        return [(pose, scan_at(pose, beams=180, noise=noise, rng=rng)) for pose in poses]

    for pose, scan in scans(40):
        maps.integrate_scan(pose[None], make_rays([scan], usable_range=20.0))
    longer = np.linspace(-0.04, 0.04, 33)
    fits = np.zeros(len(longer))
    for pose, scan in scans(40):
        for k, more in enumerate(longer):
            angles = scan.angles + scan.mount[2]
            ends = (scan.ranges + more)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]) + scan.mount[:2]
            fits[k] += log_likelihoods(maps, pose[None], ends, model)[0]
    assert abs(longer[np.argmax(fits)]) <= most
