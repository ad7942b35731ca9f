# SPDX-License-Identifier: MIT
"""Blocks of paths: put together they are the path, and little of it is sent twice."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from testbed.views.rerun.layers.path_blocks import BLOCK, GrowingPath, PathBlocks


def joined(blocks: dict[int, np.ndarray]) -> np.ndarray:
    """The path that blocks show, (n, 3): each begins with the last pose of the one before."""
    shown = [blocks[number] for number in sorted(blocks) if len(blocks[number])]
    if not shown:
        return np.zeros((0, 3))
    assert all(np.array_equal(a[-1], b[0]) for a, b in itertools.pairwise(shown))
    return np.concatenate([shown[0], *(block[1:] for block in shown[1:])])


@given(st.lists(st.integers(0, 450), min_size=1, max_size=6), st.integers(0, 2**32 - 1))
def test_a_path_that_is_extended_is_sent_as_the_whole_path_would_be(counts: list[int], seed: int) -> None:
    rng, path, extended, whole = np.random.default_rng(seed), np.zeros((0, 3)), PathBlocks(), PathBlocks()
    for count in counts:
        more = rng.normal(size=(count, 3))
        path = np.concatenate([path, more])
        expected, found = whole.changes(path), extended.extended(more)
        assert [number for number, _ in found] == [number for number, _ in expected]
        assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(found, expected, strict=True))


@example([(0, 202), (0, 201), (0, 2)], 0)
@example([(0, 202), (0, 201), (0, 201)], 0)
@given(st.lists(st.tuples(st.integers(0, 900), st.integers(0, 400)), min_size=1, max_size=6), st.integers(0, 2**32 - 1))
def test_blocks_show_the_path_whatever_changes(changes: list[tuple[int, int]], seed: int) -> None:
    rng, path, blocks, sent = np.random.default_rng(seed), np.zeros((0, 3)), PathBlocks(), {}
    for kept, more in changes:
        path = np.concatenate([path[:kept], rng.normal(size=(more, 3))])
        sent |= dict(blocks.changes(path))
        if len(path) > 1:
            np.testing.assert_array_equal(joined(sent), path)


def test_only_the_end_of_a_path_that_grows_is_sent() -> None:
    path, whole, growing = np.random.default_rng(0).normal(size=(3 * BLOCK, 3)), PathBlocks(), GrowingPath()
    sent: dict[int, np.ndarray] = {}
    for k, pose in enumerate(path):
        growing.append(pose)
        changed = growing.changes()
        assert len(changed) <= 2
        assert [number for number, _ in whole.changes(path[: k + 1])] == [number for number, _ in changed]
        sent |= dict(changed)
    np.testing.assert_array_equal(joined(sent), path)
    assert whole.changes(path) == []
