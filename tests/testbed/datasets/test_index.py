# SPDX-License-Identifier: MIT
"""The index of a collection, and its splits by world."""

import json
import re
import shutil

import numpy as np
import pytest

from testbed.datasets import Collection, open_collection
from testbed.datasets.index import SPLITS, datasets_in, splits, write_index
from tests.shell import assert_refused, call

DRAWS = ("--draw", "lidar=lds01,rplidar_a2", "--draw", "noise=0.5..2")


def test_the_index_says_what_each_dataset_is(made):
    collection = open_collection(made)
    assert [row["dataset"] for row in collection.rows] == [path.name for path in datasets_in(made)]
    for row, dataset in zip(collection.rows, collection, strict=True):
        drawn = json.loads(row["draws"])
        assert drawn["lidar"] == row["lidar"] == dataset.settings["lidar"]
        assert drawn["noise"] == dataset.settings["noise"]
        assert 0.5 <= drawn["noise"] <= 2.0
        steps = np.diff(dataset.table.truth[:, :2], axis=0)
        assert row["metres"] == pytest.approx(np.hypot(*steps.T).sum(), abs=1e-3)
        assert row["scans"] == len(dataset)
        assert dataset.scans.shape[1] == {"lds01": 360, "rplidar_a2": 800}[row["lidar"]]
    assert len({json.loads(row["draws"])["noise"] for row in collection.rows}) == 9
    assert collection.totals()["datasets"] == 9


def test_no_world_is_in_two_splits(made):
    collection = open_collection(made)
    parts = [collection.split(name) for name in ("train", "validation", "test")]
    worlds = [{row["world"] for row in part.rows} for part in parts]
    assert all(len(found) == 1 for found in worlds)
    assert len(set.union(*worlds)) == 3
    assert sum(map(len, parts)) == len(collection)
    (split,) = {row["split"] for row in collection.where(world="office").rows}
    found = collection.where(world="office", split=split).rows
    assert {row["dataset"] for row in found} == {f"office-000{seed}" for seed in range(3)}


@pytest.mark.parametrize("count", [1, 2, 3, 10, 100])
def test_shares_of_the_splits(count):
    found = list(splits(f"world-{k}" for k in range(count)).values())
    kept = {name: found.count(name) for name in ("train", "validation", "test")}
    expected = {1: (1, 0, 0), 2: (1, 0, 1), 3: (1, 1, 1), 10: (6, 2, 2), 100: (70, 15, 15)}
    assert (kept["train"], kept["validation"], kept["test"]) == expected[count]


def test_splits_can_be_chosen_and_stay(made, tmp_path, capsys):
    for name in ("loop-0000", "office-0000", "office-0001", "maze-1-0000"):
        shutil.copytree(made / name, tmp_path / name)
    assert call("datasets", "index", tmp_path, "--test", "office", "--validation", "loop") == 0
    assert call("datasets", "index", tmp_path) == 0  # as simulate does at its end
    found = {row["world"]: row["split"] for row in open_collection(tmp_path).rows}
    assert found == {"office": "test", "loop": "validation", "maze-1": "train"}
    index = (tmp_path / "datasets.parquet").read_bytes()
    for options, complaint in (
        (("--test", "offise"), "no datasets of world offise, expected one of loop, maze-1, office"),
        (("--test", "office", "--validation", "office"), "office: named twice"),
    ):
        assert_refused(capsys, complaint, "datasets", "index", tmp_path, *options)
    assert (tmp_path / "datasets.parquet").read_bytes() == index


def test_the_hash_decides_the_splits_again(made, tmp_path, capsys):
    for name in ("loop-0000", "office-0000", "maze-1-0000"):
        shutil.copytree(made / name, tmp_path / name)
    assert call("datasets", "index", tmp_path, "--test", "office,loop,maze-1") == 0
    output = capsys.readouterr().out
    assert "Nothing for train and validation" in output
    assert f"`testbed datasets index {tmp_path} --by-hash` undoes the choice" in output
    assert call("datasets", "index", tmp_path, "--by-hash") == 0
    assert "undoes" not in capsys.readouterr().out
    found = {row["world"]: row["split"] for row in open_collection(tmp_path).rows}
    assert found == splits(["office", "loop", "maze-1"])
    assert_refused(capsys, "--by-hash: undoes a choice", "datasets", "index", tmp_path, "--by-hash", "--test", "loop")


def test_datasets_are_in_the_order_of_their_numbers(made, tmp_path):
    for name in ("rooms-10-0000", "rooms-2-0000", "rooms-2-0011", "office-0000"):
        shutil.copytree(made / "loop-0000", tmp_path / name)
    names = [path.name for path in datasets_in(tmp_path)]
    assert names == ["office-0000", "rooms-2-0000", "rooms-2-0011", "rooms-10-0000"]


def test_the_index_is_the_same_again(made):
    before = (made / "datasets.parquet").read_bytes()
    write_index(made)
    assert (made / "datasets.parquet").read_bytes() == before


def test_info_names_many_worlds_in_a_line(tmp_path, capsys, monkeypatch):
    """Worlds of one kind by ranges of their numbers; a name with a leading zero is no number."""
    worlds = ["office", *(f"rooms-{k}" for k in (*range(14), 15, 17, 18, 19)), "hall-2", "floor-007", "lab"]
    row = {"seconds": 1.0, "metres": 1.0, "scans": 10, "bytes": 100, "lidar": "lds01", "split": "train"}
    rows = [row | {"world": world, "collided": False, "stuck": False, "same_places": None} for world in worlds]
    monkeypatch.setattr("testbed.datasets.open_collection", lambda directory: Collection(directory, rows))
    assert call("datasets", "info", tmp_path) == 0
    output = capsys.readouterr().out
    assert "\nworlds of train: floor-007, hall-2, lab, office, rooms-0 to 13, 15, 17 to 19\n" in output
    assert "worlds of test" not in output
    monkeypatch.setattr("testbed.cli.datasets.MAX_NAMES", 4)
    assert call("datasets", "info", tmp_path) == 0
    assert "lab, office and 18 others (`--json` names all)\n" in capsys.readouterr().out


def test_info_prints_the_totals(made, capsys):
    assert call("datasets", "info", made, "--json") == 0
    totals = json.loads(capsys.readouterr().out)
    licence = totals.pop("licence")
    assert (licence, totals.pop("splits_chosen")) == ("CC-BY-4.0", False)
    assert [totals.pop(name) for name in ("title", "author", "url")] == [None] * 3
    assert totals == open_collection(made).totals()
    named = {split: {row["world"] for row in open_collection(made).rows if row["split"] == split} for split in SPLITS}
    assert {split: set(worlds) for split, worlds in totals["split_worlds"].items()} == named
    assert call("datasets", "info", made) == 0
    output = capsys.readouterr().out
    assert re.search(r"lds01 +\d +\d +\d\nrplidar_a2 +\d +\d +\d\n", output)
    assert "share at most" in output
    for split, worlds in named.items():
        assert f"\nworlds of {split}: {', '.join(sorted(worlds))}\n" in output
    assert "the splits come from a hash" in output


def test_an_empty_directory_is_told_how_to_make_datasets(tmp_path, capsys):
    assert_refused(capsys, f"`testbed simulate office,lab --count 2 --out {tmp_path}`", "datasets", "info", tmp_path)
