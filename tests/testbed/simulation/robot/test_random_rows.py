# SPDX-License-Identifier: MIT
"""Random numbers drawn ahead: each robot's own, whatever the others do."""

import numpy as np

from testbed.simulation.robot.random_rows import RandomRows


def rows_of(robot, seed, count, robots=3, others=()):
    """Uniform and normal rows of one robot, while others go on as listed."""
    numbers = RandomRows(robots, 4, 5, rows=8)
    for other in range(robots):
        numbers.seed(other, np.random.default_rng(100 + other))
    numbers.seed(robot, np.random.default_rng(seed))
    found = []
    for _ in range(count):
        for other in others:
            numbers.advance(np.array([other]))
        uniform, normal = numbers.next_of(robot)
        found.append(np.concatenate([uniform[0], normal[0]]))
    return np.array(found)


def test_a_robot_gets_the_numbers_of_its_own_generator():
    alone = rows_of(1, seed=7, count=30)
    assert np.array_equal(alone, rows_of(1, seed=7, count=30, others=(0, 2, 0)))
    assert np.array_equal(alone, rows_of(0, seed=7, count=30, robots=1))
    assert not np.array_equal(alone, rows_of(1, seed=8, count=30))


def test_single_and_joint_steps_give_the_same_rows():
    numbers = RandomRows(2, 4, 5, rows=8)
    for robot in range(2):
        numbers.seed(robot, np.random.default_rng(robot))
    for row in rows_of(0, seed=0, count=20, robots=1):
        numbers.advance(np.array([0, 1]))
        at = numbers.row[0]
        assert np.array_equal(np.concatenate([numbers.uniform[0, at], numbers.normal[0, at]]), row)


def test_rows_never_repeat_and_a_new_seed_starts_anew():
    rows = rows_of(0, seed=1, count=100)
    assert len(np.unique(rows)) == rows.size
    numbers = RandomRows(1, 4, 5, rows=8)
    for _ in range(2):
        numbers.seed(0, np.random.default_rng(1))
        for row in rows[:11]:
            assert np.array_equal(np.concatenate(numbers.next_of(0), axis=1)[0], row)


def test_several_rows_at_once_are_the_same_rows():
    rows = rows_of(0, seed=3, count=40, robots=1)
    numbers, found = RandomRows(1, 4, 5, rows=8), 0
    numbers.seed(0, np.random.default_rng(3))
    for most in (1, 3, 8, 20, 2, 7, 5):
        some = np.concatenate(numbers.next_of(0, most), axis=1)
        assert 1 <= len(some) <= most
        assert np.array_equal(some, rows[found : found + len(some)])
        found += len(some)


def test_numbers_are_uniform_and_normal():
    uniform, normal = np.split(rows_of(0, seed=2, count=4000), [4], axis=1)
    assert abs(uniform.mean() - 0.5) < 4.0 / np.sqrt(12.0 * uniform.size)
    assert 0.0 <= uniform.min() < uniform.max() < 1.0
    assert abs(normal.mean()) < 4.0 / np.sqrt(normal.size)
    assert abs(normal.std() - 1.0) < 4.0 / np.sqrt(2.0 * normal.size)
