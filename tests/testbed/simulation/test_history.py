# SPDX-License-Identifier: MIT
"""Poses at a constant rate, however they come in and however much is forgotten."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.simulation.history import History

PERIOD = 1.0 / 240.0


def path(n):
    """Poses (n, 3) of a drive with many turns, headings unwrapped."""
    t = np.arange(n) * PERIOD
    return np.stack([t, np.sin(t), 9.0 * t], axis=-1)


@given(st.lists(st.integers(1, 40), min_size=1, max_size=150), st.integers(1, 200))
@settings(max_examples=40, deadline=None)
def test_what_is_kept_reads_as_the_path_that_was_told(lengths, kept):
    poses = path(1 + sum(lengths))
    history, told = History(poses[0], PERIOD), 1
    for length in lengths:
        part = poses[told : told + length].copy()
        part[:, 2] -= 2.0 * math.pi * round(part[0, 2] / (2.0 * math.pi))  # a backend tells headings of one turn
        history.extend(part)
        told += length
        history.forget_before((told - kept) * PERIOD)
        oldest = max(told - kept, 0)
        times = np.linspace(oldest, told - 1, 7) * PERIOD
        expected = np.stack([np.interp(times, np.arange(told) * PERIOD, poses[:told, k]) for k in range(3)], axis=-1)
        known = np.full(7, told)
        np.testing.assert_allclose(history.at(times, known), expected, atol=1e-9)
        all_kept, positions = history.between(times, known)
        read = np.stack([np.interp(positions, np.arange(len(all_kept)), all_kept[:, k]) for k in range(3)], axis=-1)
        np.testing.assert_allclose(read, expected, atol=1e-9)
        np.testing.assert_allclose(history.latest, poses[told - 1], atol=1e-9)
        assert history.end == pytest.approx((told - 1) * PERIOD)


def test_what_is_not_kept_is_refused():
    history = History(np.zeros(3), PERIOD)
    history.extend(path(100)[1:])
    history.forget_before(50 * PERIOD)
    for time in (49 * PERIOD, 100 * PERIOD):
        with pytest.raises(ValueError, match="not all kept"):
            history.at(np.array([time]), np.array([100]))
    with pytest.raises(ValueError, match="not all kept"):
        history.between(np.array([60, 101]) * PERIOD, np.array([100, 100]))


@given(st.integers(1, 100), st.integers(0, 60), st.floats(0.0, 200.0))
@settings(max_examples=40, deadline=None)
def test_poses_that_came_later_do_not_count(known, more, position):
    """What is read with `known` poses is what a history of only these says."""
    history, short = History(path(1)[0], PERIOD), History(path(1)[0], PERIOD)
    history.extend(path(100 + more)[1:])
    if known > 1:
        short.extend(path(known)[1:])
    times = np.array([min(position, known - 1.0 + 5e-7) * PERIOD])  # rounded up, perhaps
    assert np.array_equal(history.at(times, np.array([known])), short.at(times, np.array([known])))


def test_velocities_are_those_of_the_robots_frame():
    history = History(np.array([1.0, 2.0, 0.5 * math.pi]), 1.0)
    history.extend(np.array([[1.0, 5.0, 0.5 * math.pi + 0.2]]))
    velocity = history.velocities(np.array([0.0]), np.array([0.5]), np.array([2]))
    np.testing.assert_allclose(velocity, [[3.0, 0.0, 0.2]], atol=1e-12)


def test_what_was_read_stays_as_it_was():
    history = History(np.zeros(3), PERIOD)
    latest = history.latest
    history.extend(path(5000)[1:])
    assert np.array_equal(latest, np.zeros(3))
