# SPDX-License-Identifier: MIT
"""The margin of an answer."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eval.sweep.margin import MARGIN, Margin, parse_margin


def test_the_margin_is_a_share_but_not_below_its_floor():
    assert MARGIN.of(1.0) == pytest.approx(0.1)
    assert Margin(share=0.1, floor=0.005).of(0.01) == 0.005


@pytest.mark.parametrize(
    ("text", "margin", "words"),
    [
        ("", Margin(0.1, 0.005), "5 mm (10 % where that is more)"),
        ("2mm", Margin(0.0, 0.002), "2 mm"),
        ("2.5 cm", Margin(0.0, 0.025), "25 mm"),
        ("0.1m", Margin(0.0, 0.1), "100 mm"),
        ("15%", Margin(0.15, 0.0), "15 %"),
        ("1mm, 5 %", Margin(0.05, 0.001), "1 mm (5 % where that is more)"),
    ],
)
def test_shares_lengths_and_both_are_read(text, margin, words):
    parsed = parse_margin(text)
    assert (parsed.share, parsed.floor) == (pytest.approx(margin.share), pytest.approx(margin.floor))
    assert parsed.words(is_length=True) == words


def test_a_measure_without_unit_has_a_plain_number():
    assert parse_margin("0.02").words(is_length=False) == "0.02"


@pytest.mark.parametrize("text", ["-2mm", "2 parsecs", "10%,20%", "2mm,3mm", "0", "0%,0mm", ",", "nan", "1e9", "%"])
def test_other_texts_get_one_line(text):
    with pytest.raises(ValueError, match=r"expected a share such as 10%") as caught:
        parse_margin(text)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=12))
def test_any_text_is_a_margin_or_a_value_error(text):
    try:
        margin = parse_margin(text)
    except ValueError:
        return
    assert margin.of(1.0) > 0.0
