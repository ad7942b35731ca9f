# SPDX-License-Identifier: MIT
"""Loops that the other local maps refute: a ring that is closed at the right place, and at one a few metres off."""

from functools import cache

import numpy as np
import pytest

from slam import FilterConfig, se2
from slam._threads import Threads
from slam.loops.correlative_match import prepare, thinned
from slam.loops.find_loops import find_loops
from slam.loops.local_maps import track_locally
from slam.loops.loop import edges_of
from slam.loops.pose_graph import join, optimise
from slam.loops.refuted_loops import refuted_loops, support
from tests.slam.loops.ring import drifting, lap, rays_at

CONFIG, ONE = FilterConfig(), Threads(1)


@cache
def ring():
    """Maps, the graph of the loops that are found where the path is open, and the true poses of the maps."""
    truth = lap(58.0)
    odometry, path = drifting(truth, 1.01, 0.002), drifting(truth, 1.0, 0.01)
    track = track_locally(odometry, path, rays_at(truth), CONFIG, ONE)
    frames = track.frames[track.anchors]
    found = find_loops(track, path[frames], CONFIG, ONE)
    return [prepare(local, CONFIG.map.cell) for local in track.maps], found, truth[frames]


def closed_by(loops):
    """Poses of the maps where these loops are closed."""
    _, found, truth = ring()
    edges = join(found.chain, edges_of(loops))
    return optimise(se2.compose(found.poses[0], se2.between(truth[0], truth)), edges, np.ones(len(edges.first)))


def displaced(loop, by):
    return loop._replace(pose=loop.pose + by)


def test_right_loops_stand():
    maps, found, _ = ring()
    loops = [loop._replace(was_closed=False) for loop in found.loops]
    assert found.accepted.all()
    assert refuted_loops(maps, closed_by(loops), found.chain, loops) == []


@pytest.mark.parametrize("by", [(2.0, 0.0, 0.0), (0.0, -2.0, 0.0), (1.0, 1.0, 0.3)])
def test_a_loop_that_lays_other_maps_over_wrong_walls_is_refuted(by):
    maps, found, _ = ring()
    wrong = [displaced(found.loops[0]._replace(was_closed=False), by)]
    assert refuted_loops(maps, closed_by(wrong), found.chain, wrong) == [0]


def test_loops_that_join_the_same_places_fall_together():
    """Without one of them the other still holds the graph bent: nothing would speak against either alone."""
    maps, found, _ = ring()
    wrong = displaced(found.loops[0]._replace(was_closed=False), (2.0, 0.0, 0.0))
    both = [wrong, wrong]
    assert refuted_loops(maps, closed_by(both), found.chain, both) == [0, 1]


def test_loops_that_the_path_had_closed_are_not_in_question():
    maps, found, _ = ring()
    wrong = [displaced(found.loops[0]._replace(was_closed=True), (2.0, 0.0, 0.0))]
    assert refuted_loops(maps, closed_by(wrong), found.chain, wrong) == []


def test_the_right_poses_have_the_most_support():
    maps, _, truth = ring()
    best = support(maps, truth)
    for seed in range(5):
        moved = truth + np.random.default_rng(seed).normal(0.0, (0.5, 0.5, 0.05), truth.shape)
        assert support(maps, moved) < 0.5 * best


def test_thinned_maps_keep_walls_that_are_there():
    maps, _, _ = ring()
    few = thinned(maps[0], 40)
    assert 20 <= len(few.walls) <= 40
    assert len(few.facing) == len(few.walls)
    assert {tuple(wall) for wall in few.walls} <= {tuple(wall) for wall in maps[0].walls}
