# SPDX-License-Identifier: MIT
"""The correlative search: against trying everything, and on maps whose relative pose is known."""

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import FilterConfig, se2
from slam._threads import Threads
from slam.loops._correlative_kernels import pool_maxima, search
from slam.loops.correlative_match import MAX_SCORE, agreement, prepare, refine_pose, search_window
from slam.loops.local_maps import LocalMap, track_locally
from tests.slam.loops.ring import drifting, lap, rays_at

CONFIG, ONE = FilterConfig(), Threads(1)
NOWHERE = np.array([0, 0, 0, -1, -1])


def try_everything(values, points, reach, avoid=NOWHERE):
    """The largest score of all displacements and headings, by the book."""
    rows, columns = values.shape
    best = 0
    for h, at in enumerate(points):
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                if abs(dx - avoid[0]) <= avoid[3] and abs(dy - avoid[1]) <= avoid[3] and abs(h - avoid[2]) <= avoid[4]:
                    continue
                x, y = at[:, 0] + dx, at[:, 1] + dy
                inside = (x >= 0) & (y >= 0) & (x < columns) & (y < rows)
                best = max(best, int(values[y[inside], x[inside]].sum()))
    return best


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), reach=st.integers(0, 9), box=st.integers(-1, 3))
def test_branch_and_bound_finds_what_trying_everything_finds(seed, reach, box):
    rng = np.random.default_rng(seed)
    values = rng.integers(-1, MAX_SCORE + 1, rng.integers(5, 30, 2)).astype(np.int8)
    levels = np.zeros((4, *values.shape), np.int8)
    pool_maxima(values, levels)
    points = rng.integers(-4, 30, (3, rng.integers(1, 12), 2))
    avoid = np.array([1, -1, 1, box, box])
    best = np.zeros(3, np.int64)
    score = search(levels, points, reach, 0, avoid, best)
    assert score == try_everything(values, points, reach, avoid)
    if score > 0:
        x, y = (points[best[2]] + best[:2]).T
        inside = (x >= 0) & (y >= 0) & (x < values.shape[1]) & (y < values.shape[0])
        assert values[y[inside], x[inside]].sum() == score


@cache
def two_visits():
    """A local map of the first corner of the ring and one of the same corner a lap later, and their relative pose."""
    truth = lap(58.0)
    track = track_locally(drifting(truth, 1.0, 0.0), truth, rays_at(truth), CONFIG, ONE)
    at = truth[track.frames[track.anchors]]
    apart = np.hypot(*(at[:, None, :2] - at[None, :, :2]).T)
    apart[np.abs(np.subtract.outer(range(len(at)), range(len(at)))) < 4] = np.inf
    j, i = np.unravel_index(np.argmin(apart), apart.shape)
    i, j = sorted((i, j))
    maps = [prepare(track.maps[k], CONFIG.map.cell) for k in (i, j)]
    return *maps, se2.between(at[i], at[j])


@settings(deadline=None, max_examples=30)
@given(x=st.floats(-2, 2), y=st.floats(-2, 2), turn=st.floats(-0.3, 0.3))
def test_the_pose_of_a_second_visit_is_found(x, y, turn):
    first, second, true = two_visits()
    match = search_window(first, second, se2.compose(true, (x, y, turn)), 3.0, 0.4)
    assert match is not None
    pose, covariance = refine_pose(first, second, match.pose, CONFIG, ONE)
    error = se2.between(true, pose)
    assert np.hypot(error[0], error[1]) < 0.1
    assert abs(error[2]) < 0.02
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


def test_agreement_counts_both_directions():
    first, second, true = two_visits()
    right, off = agreement(first, second, true), agreement(first, second, se2.compose(true, (0.0, 0.6, 0.0)))
    assert right.share > 0.95
    assert off.share < 0.7
    back = agreement(second, first, se2.inverse(true))
    assert back == right


def test_no_overlap_is_no_match():
    first, second, true = two_visits()
    assert search_window(first, second, se2.compose(true, (80.0, 0.0, 0.0)), 1.0, 0.1) is None


CELL = CONFIG.map.cell


def drawn(walls, free):
    """A map of 12 m by 6 m with its anchor in its corner; walls and free space as slices of rows and columns."""
    states = np.zeros((120, 240), np.int8)
    for area in free:
        states[area] = -1
    for area in walls:
        states[area] = 1
    rows, columns = np.nonzero(states == 1)
    centres = np.column_stack([columns + 0.5, rows + 0.5]) * CELL
    return prepare(LocalMap(anchor=0, walls=centres, states=states, origin=np.zeros(3)), CELL)


def test_the_two_faces_of_a_thin_wall_are_not_one_wall():
    wall = np.s_[60:61, 20:220]
    above, below = drawn([wall], [np.s_[61:100, 20:220]]), drawn([wall], [np.s_[20:60, 20:220]])
    assert agreement(above, above, np.zeros(3)).share == 1.0
    seen_from_both_sides = agreement(above, below, np.zeros(3))
    assert seen_from_both_sides.overlap < 10
    assert seen_from_both_sides.share < 0.1


def corner(column):
    """Two walls that meet, one third of a map wide."""
    return [np.s_[30:31, column : column + 40], np.s_[30:80, column : column + 1]]


def test_a_place_that_is_there_twice_has_a_rival():
    floor = [np.s_[20:100, 10:230]]
    once, twice = drawn(corner(40), floor), drawn(corner(40) + corner(120), floor)
    alone = search_window(once, once, np.zeros(3), 5.0, 0.1)
    doubtful = search_window(twice, once, np.zeros(3), 5.0, 0.1)
    assert alone.rivalry < 0.8
    assert doubtful.rivalry > 0.95
