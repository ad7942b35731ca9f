# SPDX-License-Identifier: MIT
"""The tree of histories holds what the filter's own ancestry holds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.particles.ancestry import Ancestry
from testbed.views.rerun.layers import particle_tree
from testbed.views.rerun.layers.particle_tree import ParticleTree


@pytest.fixture(autouse=True, scope="module")
def all_points() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(particle_tree, "MAX_POINTS", 10**9)
        yield


def limbs(strips: list[np.ndarray]) -> list[tuple[float, ...]]:
    return [(*map(float, a), *map(float, b)) for strip in strips for a, b in itertools.pairwise(strip)]


@settings(deadline=None)  # the first call compiles kernels
@given(st.integers(1, 10), st.integers(1, 25), st.integers(0, 2**32 - 1))
def test_each_limb_of_the_living_tree_is_drawn_once(particles: int, updates: int, seed: int) -> None:
    rng, ancestry, tree = np.random.default_rng(seed), Ancestry(particles), ParticleTree()
    poses = np.zeros((particles, 3))
    for _ in range(updates):
        proposed = poses = rng.normal(size=(len(poses), 3))
        ancestry.add(proposed)
        if rng.uniform() < 0.4:
            parents = np.sort(rng.integers(len(poses), size=rng.integers(1, 11)))
            poses = proposed[parents]
            ancestry.inherit(parents)
            branches = tree.add(proposed, poses)
            if not np.array_equal(proposed, poses):
                assert branches is not None
                ends = {tuple(branch[-1]) for branch in branches}
                assert ends == {tuple(p) for p in proposed[:, :2]} - {tuple(p) for p in poses[:, :2]}
        else:
            assert tree.add(proposed, poses) is None
    paths = [ancestry.path(i)[:, :2] for i in range(len(poses))]
    drawn = limbs(tree.strips())
    assert len(drawn) == len(set(drawn))
    assert set(drawn) == set(limbs(paths))


def test_a_filter_that_begins_anew_elsewhere_has_a_new_tree() -> None:
    tree, rng = ParticleTree(), np.random.default_rng(0)
    for _ in range(5):
        poses = rng.normal(size=(3, 3))
        tree.add(poses, poses)
    tree.add(rng.normal(size=(3, 3)), rng.normal(size=(3, 3)))
    assert tree.strips() == []


def test_a_filter_that_starts_again_with_another_number_of_particles_gets_a_new_tree():
    """Localisation changes the number of particles without a proposal while it searches."""
    tree, rng = ParticleTree(), np.random.default_rng(0)
    for count in (5, 5, 9, 9, 3):
        poses = rng.normal(size=(count, 3))
        assert tree.add(poses, poses) is None
        strips = tree.strips()
    assert strips == []  # one update of the three particles: no line yet
    moved = rng.normal(size=(3, 3))
    tree.add(moved, moved)
    assert len(tree.strips()) == 3
