# SPDX-License-Identifier: MIT
"""Generated worlds are valid, repeatable, and as asked for; the walk that makes tours goes every way."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import worlds
from worlds.format.files import parse
from worlds.generation.graph import closed_walk, lattice_edges, random_graph


@given(st.integers(1, 7), st.integers(1, 7), st.integers(0, 12), st.integers(0, 2**32))
@settings(deadline=None)
def test_closed_walks_go_every_way_once_or_twice_and_return(cols, rows, loops, seed):
    graph = random_graph(cols * rows, lattice_edges(cols, rows), loops, np.random.default_rng(seed))
    walk = closed_walk(graph)
    gone = Counter(frozenset(way) for way in pairwise(walk))
    assert walk[0] == walk[-1]
    assert set(walk) == set(range(cols * rows))
    assert set(gone) == {frozenset(way) for way in graph.tree + graph.extra}
    assert max(gone.values(), default=1) <= 2
    assert all(gone[frozenset(way)] == 1 for way in graph.extra)


def test_unconnected_places_are_refused():
    with pytest.raises(ValueError, match="connected"):
        random_graph(3, [(0, 1)], 0, np.random.default_rng(0))


def assert_valid(kind, seed, **settings):
    world = worlds.generate(kind, seed=seed, **settings)
    worlds.check_world(world, footprint_radius=0.4)
    truth = worlds.true_map(world, 0.1)
    # all of the tour lies on floor that is connected with the start
    path = world.path()
    along = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(path)])
    cols, rows = np.floor((along - truth.origin[:2]) / 0.1).astype(int).T
    assert truth.free[rows, cols].all()


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_generated_worlds_are_connected_and_drivable(kind, seed):
    assert_valid(kind, seed, clutter=2.0, loops=(1, 2, 4)[seed % 3] if kind == "blocks" else seed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", worlds.KINDS)
def test_200_seeds_of_each_kind_are_connected_and_drivable(kind):
    for seed in range(200):
        rng = np.random.default_rng(seed)
        size = tuple(rng.uniform(9.0, 28.0, 2).tolist())
        clutter, loops = float(rng.uniform(0, 4)), int(rng.integers(0, 6))
        assert_valid(kind, seed, size=size, clutter=clutter, loops=1 if kind == "blocks" else loops)


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_the_same_arguments_give_the_same_world(kind):
    first, again, other = (worlds.generate(kind, seed=seed) for seed in (5, 5, 6))
    assert worlds.dumps(first) == worlds.dumps(again)
    assert worlds.dumps(first) != worlds.dumps(other)
    assert parse(worlds.dumps(first), "file") == first


@pytest.mark.parametrize("loops", [0, 1, 4])
def test_loops_are_as_many_as_asked_for(loops):
    world = worlds.generate("loops", seed=3, loops=loops, clutter=0.0)
    assert len(world.free_space().interiors) == loops


def test_clutter_fills_the_floor():
    counts = [len(worlds.generate("cave", seed=1, clutter=clutter).elements) for clutter in (0.0, 1.0, 4.0)]
    assert counts[0] < counts[1] < counts[2]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "castle"}, "expected one of rooms, corridors"),
        ({"kind": "maze", "size": (5.0, 10.0)}, "expected sides of 8 to 220 m"),
        ({"kind": "maze", "clutter": -1.0}, "expected clutter"),
        ({"kind": "maze", "loops": -1}, "expected clutter"),
    ],
)
def test_bad_requests_are_refused(settings, message):
    with pytest.raises(worlds.WorldError, match=message):
        worlds.generate(**settings)


@pytest.mark.parametrize(
    ("name", "kind", "settings"),
    [
        ("warehouse", "warehouse", {"size": (26.0, 17.0), "clutter": 0.15, "seed": 4}),
        ("maze", "maze", {"size": (14.0, 12.0), "clutter": 0.4, "loops": 3, "seed": 7}),
        ("cave", "cave", {"size": (24.0, 18.0), "clutter": 0.5, "loops": 2, "seed": 2}),
    ],
)
def test_generated_worlds_of_the_catalogue_equal_their_files(name, kind, settings):
    generated, stored = worlds.generate(kind, **settings), worlds.load(name)
    assert stored.path().shape == generated.path().shape
    np.testing.assert_allclose(stored.path(), generated.path(), atol=0.001)
    assert stored.free_space().symmetric_difference(generated.free_space()).area < 0.5
