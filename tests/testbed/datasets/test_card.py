# SPDX-License-Identifier: MIT
"""The card of a collection and its contact sheet."""

import re
import shutil
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from testbed.datasets import open_collection
from testbed.datasets.card import PAPER, SOFTWARE, TOPICS
from testbed.datasets.index import COLUMNS
from tests.shell import call

DRAWS = ("--draw", "lidar=lds01,rplidar_a2", "--draw", "noise=0.5..2")


def test_a_title_stays_until_another_is_given(made, tmp_path):
    for name in ("loop-0000", "loop-0001"):
        shutil.copytree(made / name, tmp_path / name)
    assert call("datasets", "index", tmp_path) == 0
    card = tmp_path / "README.md"
    assert f"\n# {tmp_path.name}\n" in card.read_text()
    for options in (("--title", "Two: laps"), ()):
        assert call("datasets", "index", tmp_path, *options) == 0
        text = card.read_text()
        assert "\n# Two: laps\n" in text
        assert 'pretty_name: "Two: laps"\n' in text
        assert "> Two: laps: simulated" in text
        assert 'open_collection(".")' in text


def test_the_card_names_maps_that_have_a_licence_of_their_own(made, tmp_path):
    plan = made / "office-0000" / "truth_map.yaml"
    common = ("--duration", "2", "--format", "parquet", "--out", tmp_path, "--count", "2")
    assert call("simulate", f"{plan},loop", *common) == 0
    text = (tmp_path / "README.md").read_text()
    assert "The map of `truth_map` is from a file" in " ".join(text.split())
    assert "license: other\n" in text
    assert "license: cc-by-4.0\n" in (made / "README.md").read_text()


def test_the_card_says_what_there_is_and_whose_it_is(made):
    text = (made / "README.md").read_text()
    for part in (
        "9 simulated drives",
        "in 3\nworlds",
        "license: cc-by-4.0",
        "`lds01`",
        "`noise`",
        "visits other stops",
        "longest common subsequence",
        "https://",
        "read_parquet",
    ):
        assert part in text
    for column in COLUMNS:
        assert f"`{column}`" in text
    from PIL import Image

    with Image.open(made / "contact_sheet.png") as sheet:
        assert sheet.size[0] > 240
        assert len(sheet.getcolors(1 << 24)) > 10


def test_the_card_names_all_commands_that_made_datasets(tmp_path, monkeypatch):
    both = ["--count", "2", "--seed", "0"]
    for options in (both, ["--seed", "2"], both, ["--seed", "2", "--noise", "3"]):
        arguments = ["simulate", "loop", "--out", str(tmp_path), "--duration", "0.5", *options]
        monkeypatch.setattr("sys.argv", ["testbed", *arguments])
        assert call(*arguments) == (2 if "--noise" in options else 0)
    assert call("datasets", "index", tmp_path) == 0
    assert [line.rpartition("--seed ")[2] for line in commands_of(tmp_path)] == ["0", "2"]


def test_the_card_names_no_command_that_made_nothing(tmp_path, monkeypatch):
    def simulate(*options):
        arguments = ["simulate", "loop,office", "--out", str(tmp_path), "--duration", "0.5", *options]
        monkeypatch.setattr("sys.argv", ["testbed", *arguments])
        assert call(*arguments) == 0

    made = f"testbed simulate loop,office --out {tmp_path.name} --duration 0.5"
    simulate("--count", "2")
    for options in (("--count", "2"), ("--count", "2", "--workers", "1"), ("--count", "1"), ("--route", "stops")):
        simulate(*options)
        assert commands_of(tmp_path) == [f"{made} --count 2"]
    simulate("--count", "3")
    assert commands_of(tmp_path) == [f"{made} --count 3"]
    for options, more in ((("--test", "loop"), ["--test loop"]), ((), ["--test loop"]), (("--by-hash",), [])):
        assert call("datasets", "index", tmp_path, *options) == 0
        chosen = [f"testbed datasets index {tmp_path.name} {text}" for text in more]
        assert commands_of(tmp_path) == [f"{made} --count 3", *chosen]
        assert ("chosen by hand" in (tmp_path / "README.md").read_text()) == bool(more)


def commands_of(directory):
    """The commands that the card names."""
    return (directory / "README.md").read_text().partition("## Made by\n```\n")[2].partition("\n```")[0].splitlines()


@pytest.mark.parametrize(("log_format", "part"), [("rosbag2", "`/ground_truth/odom`"), ("parquet", "`frames.parquet`")])
def test_the_card_says_what_is_in_the_recordings(tmp_path, log_format, part):
    assert call("simulate", "loop", "--out", tmp_path, "--duration", "0.5", "--format", log_format) == 0
    assert call("datasets", "index", tmp_path) == 0
    assert part in (tmp_path / "README.md").read_text()
    (dataset,) = open_collection(tmp_path)
    if log_format == "rosbag2":
        with AnyReader([dataset.path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
            assert {connection.topic for connection in bag.connections} <= set(TOPICS)


def test_a_card_of_somebody_else_is_kept(made, tmp_path, capsys):
    shutil.copytree(made / "loop-0000", tmp_path / "loop-0000")
    (tmp_path / "README.md").write_text("mine")
    assert call("datasets", "index", tmp_path) == 0
    assert "README.md is yours and was kept" in capsys.readouterr().out
    assert (tmp_path / "README.md").read_text() == "mine"


def test_the_card_keeps_who_published_the_data(made, tmp_path):
    for name in ("loop-0000", "loop-0001"):
        shutil.copytree(made / name, tmp_path / name)
    card = tmp_path / "README.md"
    assert call("datasets", "index", tmp_path) == 0
    assert f"`testbed datasets index {tmp_path.name} --author NAME" in card.read_text()
    given = ("--title", "Laps", "--author", "Ada Example", "--url", "https://example.org/laps")
    for options in (given, ()):
        assert call("datasets", "index", tmp_path, *options) == 0
        (sentence,) = (line for line in card.read_text().splitlines() if line.startswith("> Ada"))
        assert re.fullmatch(r"> Ada Example \(20\d\d\)\. Laps: .* CC-BY-4\.0\. https://example\.org/laps", sentence)


def test_the_card_names_the_software_and_paper_as_the_citation_file():
    stated = (Path(__file__).parents[3] / "CITATION.cff").read_text()
    author, title = SOFTWARE.split(", ", 1)
    paper = " ".join(PAPER.split())
    assert f"name: {author}\n" in stated
    assert f'title: "{title}"\n' in stated
    for key in ("doi", "year", "journal", "volume", "start", "end", "given-names", "family-names"):
        for value in re.findall(rf"^\W*{key}: (.*)$", stated.partition("preferred-citation")[2], re.MULTILINE):
            assert value in paper, key
