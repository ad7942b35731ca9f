# SPDX-License-Identifier: MIT
"""The maps of other particles, and which of their walls lie elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from testbed.views.map_cells import UNKNOWN
from testbed.views.rerun import entities
from testbed.views.rerun.other_particles import (
    ANY_OF_EQUAL_WEIGHT,
    NAMES,
    _elsewhere,
    first_comparison,
    other_particles,
)
from testbed.views.rerun.recorded import GridImage, Recorded
from tests.testbed.views.conftest import Recorded as Run


@pytest.mark.parametrize(("shift", "marked"), [(0.0, 0), (0.1, 0), (0.2, 40), (-0.3, 40)])
def test_a_wall_lies_elsewhere_beyond_the_reach(shift: float, marked: int) -> None:
    """A wall of 4 m, drawn on 5 cm by the best particle and on 10 cm by another one, whose map is displaced."""
    best = np.full((100, 100), 255, np.uint8)
    best[50, 10:90] = 0
    other = np.full((50, 50), 255, np.uint8)
    other[25, 5:45] = 0
    shown = GridImage(other, np.array([1.0, 2.0 + shift, 0.0]), 0.1)
    found = _elsewhere(shown, GridImage(best, np.array([1.0, 2.0, 0.0]), 0.05))
    assert found.sum() == marked
    assert not found[other > 0].any()


def test_walls_that_the_best_particle_has_not_seen_are_not_elsewhere() -> None:
    best = np.full((100, 100), UNKNOWN, np.uint8)
    other = np.zeros((50, 50), np.uint8)
    assert not _elsewhere(GridImage(other, np.zeros(3), 0.1), GridImage(best, np.zeros(3), 0.05)).any()


def test_each_rank_but_the_best_is_drawn_each_particle_once(recorded: Run) -> None:
    read = Recorded(recorded.path)
    found = other_particles(read, np.inf)
    drawn = [other.title.partition(": ")[2] for other in found]
    names = ", ".join(other.title.partition(": ")[0] for other in found)
    assert len(set(drawn)) == len(drawn)  # no particle is drawn twice
    assert names.replace(ANY_OF_EQUAL_WEIGHT, NAMES["lightest"]).split(", ") == list(NAMES.values())
    assert all("weight" in other.title and other.elsewhere.shape == other.map.image.shape for other in found)
    assert other_particles(read, -1.0) == []


def test_none_is_called_the_lightest_where_all_weigh_the_same(recorded: Run) -> None:
    read, start = Recorded(recorded.path), recorded.snapshots[0].stamp
    seen = set()
    for snapshot in recorded.snapshots[1:]:
        time = snapshot.stamp - start
        if time not in read.times(f"{entities.COMPARE}/lightest/robot/label"):
            continue
        equal = bool(np.ptp(snapshot.weights) < 1e-12)
        titles = [other.title for other in other_particles(read, time)]
        if titles:
            seen.add(equal)
            assert titles[0].startswith(ANY_OF_EQUAL_WEIGHT) is equal
            assert titles[0].startswith("lightest") is not equal
    assert seen == {True, False}


def test_the_first_comparison_is_where_they_begin_to_be_shown(recorded: Run) -> None:
    read = Recorded(recorded.path)
    first = first_comparison(read)
    assert first is not None
    assert other_particles(read, first) != []
    assert other_particles(read, first - 0.05) == []
