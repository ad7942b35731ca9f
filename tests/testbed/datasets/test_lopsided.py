# SPDX-License-Identifier: MIT
"""What is said where most of the driving time is not for training."""

import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.cli.shared.dataset_plan import share_lines
from testbed.datasets.index import splits
from testbed.datasets.lopsided import lopsided, time_shares
from tests.shell import call

TWO = {"office": 300.0, "apartment": 100.0}


def test_the_time_of_each_split_is_a_share_of_all():
    of_world = {"office": "test", "apartment": "train"}
    assert time_shares(TWO, of_world) == "of the driving time: train 25 %, validation 0 %, test 75 %"


def test_only_a_small_training_set_is_lopsided():
    assert lopsided(TWO, {"office": "train", "apartment": "test"}, Path("data")) == ""
    assert lopsided(TWO, {"office": "test"}, Path("data")) == ""
    assert "training has only 25 % of the" in lopsided(TWO, {"office": "test", "apartment": "train"}, Path("data"))


@given(st.dictionaries(st.sampled_from("abcdefgh"), st.floats(1.0, 1e6), min_size=2))
def test_the_proposed_choice_gives_training_more_and_leaves_no_split_empty(seconds):
    before = splits(seconds)
    advice = lopsided(seconds, before, Path("data"))
    if "`" not in advice:
        return
    words = advice.split("`")[1].split()[4:]
    better = splits(seconds, {world: option[2:] for option, world in zip(words[::2], words[1::2], strict=True)})
    assert better[max(seconds, key=lambda world: (seconds[world], world))] == "train"
    assert set(better.values()) == set(before.values())

    def trained(of_world):
        return sum(seconds[world] for world, split in of_world.items() if split == "train")

    assert trained(better) > trained(before)


def test_no_choice_is_proposed_where_none_would_help():
    seconds = dict.fromkeys("abc", 100.0)
    assert lopsided(seconds, splits(seconds), Path("data")).endswith(
        "whole worlds. More worlds bring it nearer to 70 %."
    )


def test_a_plan_says_that_a_split_is_lopsided_unless_it_was_chosen(tmp_path):
    shares, advice = share_lines(TWO, {}, tmp_path)
    assert shares == "of the driving time: train 25 %, validation 0 %, test 75 %"
    assert f"`testbed datasets index {tmp_path} --test apartment`" in advice
    assert share_lines(TWO, {"office": "test", "lab": "validation"}, tmp_path) == [shares]


@pytest.fixture
def two_worlds(made, tmp_path):
    """Three drives of loop, which the hash of the names keeps for testing, and one of office."""
    data = tmp_path / "data"
    shutil.copytree(made / "office-0000", data / "office-0000")
    for number in range(3):
        shutil.copytree(made / "loop-0000", data / f"loop-000{number}")
    return data


def test_index_and_info_say_that_a_split_is_lopsided(two_worlds, capsys):
    for command in ("index", "info"):
        assert call("datasets", command, two_worlds) == 0
        assert f"`testbed datasets index {two_worlds} --test office`" in capsys.readouterr().out
    assert call("datasets", "index", two_worlds, "--test", "loop") == 0
    assert call("datasets", "info", two_worlds) == 0
    assert "Lopsided" not in capsys.readouterr().out


def test_info_says_what_is_missing_to_publish(two_worlds, capsys):
    def said():
        assert call("datasets", "info", two_worlds) == 0
        return capsys.readouterr().out.splitlines()[-1]

    assert call("datasets", "index", two_worlds) == 0
    capsys.readouterr()
    missing = "--title TITLE --author NAME --url ADDRESS"
    assert said().endswith(
        f"no title, no author, no address yet; `testbed datasets index {two_worlds} {missing}` adds that"
    )
    assert call("datasets", "index", two_worlds, "--author", "Ada", "--title", "Laps") == 0
    capsys.readouterr()
    assert said().endswith(
        f"the card has no address yet; `testbed datasets index {two_worlds} --url ADDRESS` adds that"
    )
    assert call("datasets", "index", two_worlds, "--url", "https://example.org") == 0
    capsys.readouterr()
    assert said() == "to publish: the card has title, author and address, and the sentence to cite"
    (two_worlds / "README.md").write_text("mine\n")
    assert said() == "licence: CC-BY-4.0 (see README.md)"
    (two_worlds / "README.md").unlink()
    assert said() == f"to publish: `testbed datasets index {two_worlds}` writes a card"
