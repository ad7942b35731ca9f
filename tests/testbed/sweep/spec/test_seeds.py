# SPDX-License-Identifier: MIT
"""Lists of seeds."""

import pytest

from testbed.sweep.spec.seeds import parse_seeds


@pytest.mark.parametrize(
    ("text", "seeds"),
    [
        ("3", (0, 1, 2)),
        ("3,", (3,)),
        ("0,1,2", (0, 1, 2)),
        ("0:10", tuple(range(10))),
        ("4:6, 9 ,20:22", (4, 5, 9, 20, 21)),
        ("9223372036854775807,", (2**63 - 1,)),
    ],
)
def test_counts_lists_and_ranges_are_read(text, seeds):
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("many", "expected a number of seeds such as 10, a list such as 0,1,2, or a range such as 0:10"),
        ("", "expected a number of seeds"),
        ("1.5", "expected a number of seeds"),
        ("-3", "expected a number of seeds"),
        ("5:2", "5:2 holds no seed"),
        ("100000000", "100000000 seeds, expected 1 to 10000"),
        ("0:100000000", "more than 10000 seeds"),
        ("9223372036854775808,", "holds a seed above 9223372036854775807"),
        ("0:99999999999999999999", "expected a number of seeds"),
        ("9" * 5000 + ",", "expected a number of seeds"),
    ],
)
def test_other_texts_and_absurd_numbers_get_one_line(text, complaint):
    with pytest.raises(ValueError, match=complaint) as refused:
        parse_seeds(text)
    assert "\n" not in str(refused.value)
