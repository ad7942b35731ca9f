# SPDX-License-Identifier: MIT
"""One seed, split once into named streams."""

import dataclasses
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence

import testbed
from testbed.seeds import RunSeeds, children

ORDER = ("world", "start", "odometry", "lidar", "movers", "filter", "driver", "route", "perturbation", "surface")
"""The streams in the order in which they were introduced, which decides the numbers of all earlier results."""
SOURCES = Path(testbed.__file__).parent


def first_number(stream: SeedSequence) -> float:
    return np.random.default_rng(stream).random()


def first_numbers(seed: int) -> list[float]:
    return [first_number(getattr(RunSeeds.from_seed(seed), name)) for name in ORDER]


def test_streams_differ_between_parts_and_seeds_and_repeat():
    assert first_numbers(7) == first_numbers(7)
    numbers = [*first_numbers(7), *first_numbers(8)]
    assert len(set(numbers)) == len(numbers)


def test_streams_are_those_that_numpy_spawns_in_this_order():
    assert [field.name for field in dataclasses.fields(RunSeeds)] == ["seed", *ORDER]
    assert first_numbers(7) == [first_number(stream) for stream in SeedSequence(7).spawn(len(ORDER))]


def test_children_equal_those_of_numpy_at_every_call():
    stream = RunSeeds.from_seed(7).lidar
    expected = [first_number(child) for child in SeedSequence(7).spawn(4)[3].spawn(3)]
    assert [first_number(child) for child in children(stream, 3)] == expected
    assert [first_number(child) for child in children(stream, 3)] == expected  # unlike those of `spawn`
    assert stream.n_children_spawned == 0


def test_seeds_are_equal_by_their_number_also_in_another_process():
    seeds = RunSeeds.from_seed(7)
    assert seeds == RunSeeds.from_seed(7) != RunSeeds.from_seed(8)
    assert hash(seeds) == hash(RunSeeds.from_seed(7))
    sent = pickle.loads(pickle.dumps(seeds))
    assert first_number(sent.filter) == first_number(seeds.filter)


def test_negative_seeds_are_refused():
    with pytest.raises(ValueError, match="seed must not be negative, got -1"):
        RunSeeds.from_seed(-1)


def test_seeds_are_split_in_one_module_only():
    """Also the global generator of numpy and the one of Python are used nowhere."""
    splits = re.compile(
        r"SeedSequence|\.spawn\(|np\.random\.(?!default_rng)[a-z]|^import random|^from random", re.MULTILINE
    )
    found = {str(path.relative_to(SOURCES)) for path in SOURCES.rglob("*.py") if splits.search(path.read_text())}
    # the check of a SLAM system sets the global generators to see whether that system uses them
    assert found == {"seeds.py", "systems/check.py"}
