# SPDX-License-Identifier: MIT
"""Measures of difficulty: known answers, and what the catalogue stores."""

import numpy as np
import pytest

import worlds
from worlds.difficulty import observability

WIDE = 100.0


def test_a_corridor_constrains_one_direction_a_square_both():
    corridor = np.array([[-WIDE, 1.0, WIDE, 1.0], [-WIDE, -1.0, WIDE, -1.0]])
    square = np.array([[-5, -5, 5, -5], [5, -5, 5, 5], [5, 5, -5, 5], [-5, 5, -5, -5]], float)
    here = np.zeros(2)
    assert observability(corridor, here) == pytest.approx(0.0, abs=1e-12)
    assert observability(square, here) == pytest.approx(1.0, abs=0.02)
    assert observability(5.0 * square, here) == 0.0  # nothing in reach


def test_observability_does_not_depend_on_the_worlds_direction():
    rng = np.random.default_rng(0)
    segments = rng.uniform(-8, 8, (30, 4))
    turned = segments.copy()
    turned[:, [0, 2]], turned[:, [1, 3]] = -segments[:, [1, 3]], segments[:, [0, 2]]
    assert observability(turned, np.zeros(2)) == pytest.approx(observability(segments, np.zeros(2)), abs=1e-9)


LARGE = ("campus", "park")
"""Worlds that take as long to measure as all others together."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in worlds.catalogue()]
)
def test_the_catalogue_stores_what_is_measured(name):
    world = worlds.load(name)
    measured = worlds.measure_difficulty(world)
    for key, value in measured.model_dump().items():
        assert getattr(world.difficulty, key) == pytest.approx(value, abs=0.002)


def test_the_catalogue_is_as_diverse_as_it_says():
    stored = {name: worlds.load(name).difficulty for name in worlds.catalogue()}
    assert len(stored) >= 14
    assert stored["loop"].loops == 1
    assert stored["nested_loops"].loops == 3
    assert stored["long_corridor"].corridor_share > 0.5
    assert stored["symmetric"].symmetry == 1.0
    assert stored["hall"].symmetry == 1.0
    assert stored["courtyard"].observability < 0.2 < stored["office"].observability
    assert stored["concourse"].free_share > 0.9
    assert len(worlds.load("concourse").people) >= 5
