# SPDX-License-Identifier: MIT
"""Named random streams."""

import dataclasses

import numpy as np
import pytest

from testbed.seeds import streams


def first_numbers(seed):
    return {
        field.name: np.random.default_rng(getattr(streams(seed), field.name)).random()
        for field in dataclasses.fields(streams(seed))
    }


def test_streams_differ_from_each_other_and_between_seeds_and_repeat():
    assert first_numbers(7) == first_numbers(7)
    numbers = [*first_numbers(7).values(), *first_numbers(8).values()]
    assert len(set(numbers)) == len(numbers)


def test_negative_seeds_are_refused():
    with pytest.raises(ValueError, match="seed must not be negative"):
        streams(-1)
