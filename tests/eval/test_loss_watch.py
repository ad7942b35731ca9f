# SPDX-License-Identifier: MIT
"""While driving the estimate is lost, thrown further off, and found again: by the rules, and at the right update."""

from __future__ import annotations

import numpy as np
import pytest

from eval.loss_watch import LossWatch, Spell, lost_spells
from slam.se2 import between, compose

STEP = 0.05
"""Distance between two updates [m]."""
TRUTH = np.column_stack([STEP * np.arange(600), np.zeros(600), np.zeros(600)])
T_MAP_WORLD = np.array([3.0, -2.0, 2.5])


def changes(estimate: np.ndarray) -> list[tuple[str, int]]:
    """Kinds and updates of what changes, for an estimate (600, 3) that is given in the world's frame."""
    watch = LossWatch()
    found = [
        watch.update(*poses) for poses in zip(TRUTH.tolist(), compose(T_MAP_WORLD, estimate).tolist(), strict=True)
    ]
    return [(change.kind, change.since) for change in found if change is not None]


def moved(rows: slice, motion: list[float]) -> np.ndarray:
    """The truth, but for some rows, which lie elsewhere as a whole."""
    poses = TRUTH.copy()
    first = poses[rows][0]
    poses[rows] = compose(compose(first, motion), between(first, poses[rows]))
    return poses


def test_an_estimate_that_follows_changes_nothing() -> None:
    noise = np.random.default_rng(0).normal(0.0, [0.03, 0.03, 0.02], TRUTH.shape)
    noise[0] = 0.0  # the frames are aligned there
    assert changes(TRUTH + noise) == []


@pytest.mark.parametrize("motion", [[0.7, 0.0, 0.0], [0.0, 0.0, np.radians(40.0)]])
def test_a_jump_is_a_loss_at_its_update_and_the_way_back_is_finding(motion: list[float]) -> None:
    found = changes(moved(slice(200, 300), motion))
    assert found[0] == ("lost", 200)
    assert found[1][0] == "found"
    assert 300 <= found[1][1] <= 301
    assert len(found) == 2


def test_a_blip_is_no_loss_then_or_a_metre_later() -> None:
    """Two poses of 39 degrees, and others of 60 cm: neither they nor the metres that begin at them count."""
    blips = moved(slice(200, 202), [0.1, 0.0, np.radians(39.0)])
    blips[300:303] += [0.0, 0.6, 0.0]
    assert changes(blips) == []


def test_each_loss_is_said_and_what_throws_it_further_off() -> None:
    poses = moved(slice(200, 300), [0.7, 0.0, 0.0])
    poses[400:] += [0.8, 0.0, 0.0]
    poses[480:, 1] += 1.0
    found = changes(poses)
    assert [kind for kind, _ in found] == ["lost", "found", "lost", "further"]
    assert [found[k][1] for k in (0, 2, 3)] == [200, 400, 480]


def test_drift_is_no_loss_and_to_jump_back_is_none() -> None:
    """A metre of drift over ten of path, then a loop closure that pulls the estimate back onto the truth."""
    poses = TRUTH.copy()
    poses[100:300, 1] += np.linspace(0.0, 1.0, 200)
    found = changes(poses)
    assert [kind for kind, _ in found] == ["drifted", "close"]
    assert 100 < found[0][1] < 200
    assert found[1][1] == 300


def test_spells_are_those_of_the_updates_of_a_table() -> None:
    poses = moved(slice(200, 300), [0.7, 0.0, 0.0])
    poses[500:, 1] += 2.0
    steps = {
        "stamp": 100.0 + 0.1 * np.arange(600),
        "updated": np.ones(600),
        **dict(zip(("x", "y", "theta"), poses.T, strict=True)),
        **dict(zip(("true_x", "true_y", "true_theta"), TRUTH.T, strict=True)),
    }
    first, second = lost_spells(steps)
    assert first == Spell(pytest.approx(120.0), pytest.approx(130.0, abs=0.11))
    assert second == Spell(pytest.approx(150.0), None)
    assert lost_spells(steps | {"updated": np.arange(600) < 150}) == []
    assert lost_spells(steps | {"true_x": np.full(600, np.nan)}) == []
