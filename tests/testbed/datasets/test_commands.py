# SPDX-License-Identifier: MIT
"""The shortest commands that make a collection again: known answers."""

import pytest

from testbed.datasets.commands import shortest_commands

A = "testbed simulate loop --out data --count 2"


@pytest.mark.parametrize(
    ("commands", "expected"),
    [
        ([A, A], [A]),
        ([A, f"{A} --workers 4"], [A]),
        ([A, "testbed simulate loop --count 2 --out elsewhere/data_b"], [A]),
        ([f"{A} --shard 0/2", f"{A} --shard=1/2"], [A]),
        ([A, "testbed simulate loop --out data --count 6"], ["testbed simulate loop --out data --count 6"]),
        ([A, "testbed simulate loop --out data --seed 1"], [A]),
        ([A, f"{A} --seed 2"], [A, f"{A} --seed 2"]),
        ([A, f"{A} --noise 2"], [A, f"{A} --noise 2"]),
        (
            [A, "testbed simulate office,loop --out data --count 2"],
            ["testbed simulate office,loop --out data --count 2"],
        ),
        ([A, "testbed simulate --config a.toml --out data"], [A, "testbed simulate --config a.toml --out data"]),
        ([A, "what 'the owner wrote"], [A, "what 'the owner wrote"]),
        ([A, "testbed datasets index data --test loop"], [A]),
    ],
)
def test_commands_that_make_nothing_further_are_left_out(commands, expected):
    assert shortest_commands(commands, "data", {}) == expected


def test_chosen_splits_are_a_command():
    found = shortest_commands([A], "data", {"office": "test", "loop": "test", "lab": "validation"})
    assert found == [A, "testbed datasets index data --test loop,office --validation lab"]
