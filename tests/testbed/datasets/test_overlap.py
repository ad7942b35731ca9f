# SPDX-License-Identifier: MIT
"""What two drives have in common: known answers."""

import numpy as np
import pytest

from eval.files.tum import write_tum
from eval.trajectory.trajectory import Trajectory
from testbed.datasets.overlap import STEP, _pairs, common_steps, largest_overlaps, path_in_steps, share_of_places


def line(*corners):
    """A path through these corners, a point every 7 cm."""
    corners = np.array(corners, dtype=float)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    at = np.arange(0.0, lengths[-1], 0.07)
    return np.column_stack([np.interp(at, lengths, corners[:, k]) for k in (0, 1)])


SQUARE = line((0, 0), (10, 0), (10, 10), (0, 10), (0, 0))


def share(first, second):
    a, b = path_in_steps(first), path_in_steps(second)
    return common_steps(a, b) / len(a.points)


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        (SQUARE, 1.0),
        (SQUARE + np.array([0.0, 0.2]), 1.0),
        (SQUARE + np.array([3.0, 3.0]), 0.0),
        (SQUARE[::-1], 0.0),
        (line((0, 0), (10, 0), (10, 10)), 0.5),
        (line((10, 10), (0, 10), (0, 0), (10, 0), (10, 10)), 0.5),  # the same way in another order
        (line((0, 0), (10, 0), (10, -20), (10, 10), (0, 10)), 0.75),  # with a detour
    ],
)
def test_share_of_a_square(second, expected):
    assert share(SQUARE, second) == pytest.approx(expected, abs=0.04)


def test_crossings_are_not_shared():
    straight = line((0, 0), (20, 0))
    across = line(*[(0.25 + k, y) for k in range(19) for y in ((-2, 2) if k % 2 else (2, -2))])
    assert share(straight, across) == 0.0


def test_stops_on_the_way_do_not_count():
    waiting = np.repeat(SQUARE, np.where(np.arange(len(SQUARE)) == 100, 500, 1), axis=0)
    assert len(path_in_steps(waiting).points) == len(path_in_steps(SQUARE).points)
    assert share(waiting, SQUARE) == 1.0


def test_a_robot_that_stands_has_one_point():
    assert len(path_in_steps(np.zeros((5, 2))).points) == 1
    assert share(np.zeros((5, 2)), SQUARE) <= 1.0


def test_each_row_has_its_largest_overlap_in_its_world(tmp_path):
    drives = {
        "a-0": ("a", 0, SQUARE),
        "a-0-v": ("a", 0, SQUARE),  # a sensor variant of the same drive
        "a-1": ("a", 1, line((0, 0), (10, 0), (10, 10))),
        "a-2": ("a", 2, SQUARE[::-1]),
        "b-0": ("b", 0, SQUARE),
    }
    for name, (_, _, path) in drives.items():
        (tmp_path / name).mkdir()
        poses = np.column_stack([path, np.zeros(len(path))])
        write_tum(tmp_path / name / "truth.tum", Trajectory(0.1 * np.arange(len(path)), poses))
    rows = [{"dataset": name, "world": world, "seed": seed} for name, (world, seed, _) in drives.items()]
    found = largest_overlaps(tmp_path, rows)
    assert found[4] == (None, None)
    near = 2.5 * STEP / 20.0
    assert [one.overlap for one in found[:4]] == pytest.approx([0.5, 0.5, 1.0, 0.0], abs=near)
    assert [one.same_places for one in found[:4]] == pytest.approx([1.0] * 4, abs=near)  # a-2 drives a-0 backwards


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        (SQUARE[::-1], 1.0),
        (SQUARE + np.array([0.25, 0.25]), 1.0),  # points lie between those of the other
        (SQUARE + np.array([3.0, 3.0]), 0.0),
        (line((0, 0), (10, 0)), 0.25),
        (line((0, 0), (10, 0), (10, -20), (10, 10), (0, 10)), 0.75),
    ],
)
def test_share_of_places_of_a_square(second, expected):
    a, b = path_in_steps(SQUARE), path_in_steps(second)
    assert share_of_places(a, b) == pytest.approx(expected, abs=0.04)
    assert share(SQUARE, second) <= share_of_places(a, b)


@pytest.mark.parametrize("count", [2, 3, 10, 101])
def test_pairs_are_evenly_chosen(count):
    pairs = list(_pairs(count, 150))
    often = np.bincount(np.ravel(pairs), minlength=count)
    assert len(pairs) <= max(150, count)
    assert often.min() == often.max() >= 1
    assert len({frozenset(pair) for pair in pairs}) == len(pairs)
