# SPDX-License-Identifier: MIT
"""Loop closing: a ring that a path has left open, one that it has closed, and a place that only looks the same."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from slam import FilterConfig, se2
from slam._threads import Threads
from slam.loops import close_loops
from slam.loops.find_loops import MIN_PREDICTIONS, MIN_SCALE, _Search, find_loops
from slam.loops.local_maps import track_locally
from tests.slam.loops.ring import drifting, lap, rays_at
from tests.slam.rooms import closed

CONFIG, ONE = FilterConfig(), Threads(1)


@cache
def recording():
    truth = lap(58.0)
    return truth, drifting(truth, 1.01, 0.002), rays_at(truth)


def worst_error(path, truth):
    """Largest distance from the truth, both seen from the first pose [m]."""
    off = se2.between(path[0], path) - se2.between(truth[0], truth)
    return np.hypot(off[:, 0], off[:, 1]).max()


@pytest.mark.parametrize("bend", [0.01, -0.02])
def test_an_open_loop_is_closed(bend):
    truth, odometry, rays = recording()
    path = drifting(truth, 1.0, bend)  # opens the ring by half a metre and by one
    closing = close_loops(odometry, path, rays, CONFIG, ONE)
    assert closing.changed
    assert closing.accepted.sum() >= 1
    assert worst_error(path, truth) > 1.0
    assert worst_error(closing.path, truth) < 0.15
    for loop, sure in zip(closing.loops, closing.accepted, strict=True):
        i, j = closing.frames[loop.first], closing.frames[loop.second]
        error = se2.between(se2.between(truth[i], truth[j]), loop.pose)
        assert not sure or np.hypot(error[0], error[1]) < 0.15


def test_a_closed_loop_leaves_the_path_as_it_is():
    truth, odometry, rays = recording()
    closing = close_loops(odometry, truth, rays, CONFIG, ONE)
    assert closing.accepted.any()
    assert all(loop.was_closed for loop in closing.loops)
    assert not closing.changed
    assert closing.path is truth


def test_good_predictions_of_loops_narrow_the_windows_of_the_search():
    truth, odometry, rays = recording()
    track = track_locally(odometry, truth, rays, CONFIG, ONE)
    search = _Search(track, truth[track.frames[track.anchors]], CONFIG, ONE)
    before = np.stack([search._position, search._heading])
    search._squares = [0.0] * MIN_PREDICTIONS
    search._measure_uncertainty()
    after = np.stack([search._position, search._heading])
    np.testing.assert_allclose(after, np.sqrt(MIN_SCALE) * before, rtol=1e-4)


def test_result_does_not_depend_on_the_threads():
    truth, odometry, rays = recording()
    path = drifting(truth, 1.0, 0.01)
    one, three = (close_loops(odometry, path, rays, CONFIG, Threads(n)) for n in (1, 3))
    np.testing.assert_array_equal(one.path, three.path)


def test_two_rooms_that_look_the_same_are_no_loop():
    """Two equal rooms 26 m of driving apart: nothing but the odometry says that they are two."""
    room = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 1.2), (14.0, 1.2), (14.0, 2.4), (4.0, 2.4), (4.0, 5.0), (0.0, 5.0)])
    other = room * (-1.0, 1.0) + (28.0, 0.0)
    walls = np.vstack([closed(room), closed(other)])
    walls = walls[~((walls[:, 0] == 14.0) & (walls[:, 2] == 14.0))]
    xs = np.arange(1.0, 27.0, 0.2)
    there = np.column_stack([xs, np.full(len(xs), 1.8), np.zeros(len(xs))])
    turns = np.arange(0.2, np.pi, 0.2)
    turning = np.column_stack([np.full(len(turns), xs[-1]), np.full(len(turns), 1.8), turns])
    truth = np.vstack([there, turning])
    closing = close_loops(drifting(truth, 1.01, 0.0), truth, rays_at(truth, walls), CONFIG, ONE)
    assert not closing.accepted.any()
    assert closing.path is truth


def test_a_short_recording_has_no_loops():
    truth = lap(3.0)
    closing = close_loops(truth, truth, rays_at(truth), CONFIG, ONE)
    assert closing.loops == []
    assert closing.path is truth


def test_maps_without_walls_match_nothing():
    truth, odometry, rays = recording()
    track = track_locally(odometry, truth, rays, CONFIG, ONE)
    blind = [replace(m, walls=np.empty((0, 2)), states=np.zeros_like(m.states)) for m in track.maps]
    unsure = replace(track, maps=blind, covariances=8.0 * track.covariances)  # so that all of them may overlap
    found = find_loops(unsure, truth[track.frames[track.anchors]], CONFIG, ONE)
    assert found.loops == []
