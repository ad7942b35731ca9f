# SPDX-License-Identifier: MIT
"""The tree of trajectories against a naive copy of all histories."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.particles._ancestry_kernels import mark_alive
from slam.particles.ancestry import Ancestry


def grown(particles, generations, resample_share, seed, most=0):
    """A tree after random resampling, the histories that it should hold, and the founders of each particle.

    most: resampling is to 1 to so many heirs; 0 = as many as there are particles
    """
    rng = np.random.default_rng(seed)
    tree = Ancestry(particles)
    histories = [[] for _ in range(particles)]
    founders = list(range(particles))
    for _ in range(generations):
        poses = rng.normal(size=(len(histories), 3))
        tree.add(poses)
        histories = [[*history, pose] for history, pose in zip(histories, poses, strict=True)]
        if rng.random() < resample_share:
            heirs = rng.integers(1, most + 1) if most else particles
            ancestors = np.sort(rng.integers(0, len(histories), heirs))
            if len(set(founders)) == 1:
                founders = list(range(len(founders)))
            tree.inherit(ancestors)
            histories = [histories[a] for a in ancestors]
            founders = [founders[a] for a in ancestors]
    return tree, histories, founders


@given(st.integers(1, 12), st.integers(0, 60), st.floats(0.0, 1.0), st.integers(0, 2**32 - 1), st.integers(0, 40))
@settings(deadline=None)
def test_paths_are_those_of_copied_histories(particles, generations, resample_share, seed, most):
    tree, histories, founders = grown(particles, generations, resample_share, seed, most)
    assert tree.generations == generations
    for particle in range(len(histories)):
        np.testing.assert_array_equal(tree.path(particle), np.reshape(histories[particle], (-1, 3)))
    assert tree.unique_ancestors == len(set(founders))
    assert tree.coalesced == (len(histories) > 1 and len(set(founders)) == 1)


def test_dead_branches_are_dropped():
    """With resampling at each step the tree holds a trunk and a short crown; without, all poses of all particles."""
    particles, generations = 30, 1000
    tree, _, _ = grown(particles, generations, 1.0, seed=0)
    assert len(tree._poses) < 6 * generations
    bush, _, _ = grown(particles, 100, 0.0, seed=0)
    assert len(bush._poses) >= particles * 100


def test_paths_share_their_beginning_after_all_descend_from_one():
    tree = Ancestry(3)
    for value in range(4):
        tree.add(np.full((3, 3), float(value)) + np.arange(3)[:, None] / 10.0)
    assert tree.unique_ancestors == 3
    tree.inherit(np.array([1, 1, 1]))
    assert tree.unique_ancestors == 1
    assert tree.coalesced
    np.testing.assert_allclose(tree.path(2)[:, 0], [0.1, 1.1, 2.1, 3.1])
    tree.inherit(np.array([0, 0, 2]))  # counting starts anew
    assert tree.unique_ancestors == 2


def test_a_single_particle_never_coalesces():
    tree = Ancestry(1)
    tree.add(np.zeros((1, 3)))
    tree.inherit(np.array([0]))
    assert tree.unique_ancestors == 1
    assert not tree.coalesced


@pytest.mark.parametrize("particles", [1, 5])
def test_a_tree_without_generations_has_empty_paths(particles):
    tree = Ancestry(particles)
    assert tree.path(particles - 1).shape == (0, 3)


@given(st.integers(1, 6), st.integers(1, 40), st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_the_state_is_a_tree_of_the_poses_and_nothing_else(particles, generations, resample_share, seed):
    """Roots have the parent -1, also after dead branches were dropped; each parent comes before its children."""
    tree, histories, _ = grown(particles, generations, resample_share, seed)
    state = tree.state()
    parents, poses = state["tree_parents"], state["tree_poses"]
    assert len(parents) == len(poses) >= generations
    for leaf, history in zip(state["tree_leaves"].tolist(), histories, strict=True):
        node, walked = leaf, []
        while node != -1:
            assert parents[node] < node
            walked.append(poses[node])
            node = parents[node]
        np.testing.assert_array_equal(walked[::-1], history)


def test_a_tree_without_poses_has_no_nodes():
    state = Ancestry(3).state()
    assert (len(state["tree_parents"]), state["tree_leaves"].tolist()) == (0, [-1, -1, -1])


def test_room_is_made_when_it_is_needed_and_for_as_much_again():
    tree = Ancestry(2)
    for _ in range(4):
        tree.add(np.zeros((2, 3)))
    assert len(tree._parents) == len(tree._poses) == 8
    tree.add(np.zeros((2, 3)))
    assert len(tree._parents) == len(tree._poses) == 2 * 8 + 4 * 2


def test_the_dead_are_not_marked():
    """Node 3 is the last one, which the parent of the root, -1, would name as an index."""
    parents = np.array([-1, 0, 0, 1])
    assert mark_alive(parents, np.array([2])).tolist() == [True, False, True, False]
