# SPDX-License-Identifier: MIT
"""A collection from the command to the arrays: drives that differ, an index, splits by world, a card."""

import json
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from eval.files.tum import read_tum
from testbed.cli.shared.draws import Draw
from testbed.datasets import open_collection, open_dataset
from testbed.datasets.card import PAPER, SOFTWARE, TOPICS
from testbed.datasets.index import COLUMNS, SPLITS, datasets_in, splits, write_index
from testbed.formats import LogError, open_log
from tests.shell import assert_refused, call

DRAWS = ("--draw", "lidar=lds01,rplidar_a2", "--draw", "noise=0.5..2")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "data"
    common = ("--duration", "6", "--format", "parquet", "--out", path)
    assert call("simulate", "office,loop,generated:maze:1", "--count", "3", *DRAWS, *common) == 0
    return path


def test_no_two_seeds_drive_the_same_way(made):
    for world in ("office", "loop", "maze-1"):
        paths = [open_dataset(made / f"{world}-000{seed}").truth for seed in range(3)]
        for first, second in ((0, 1), (0, 2), (1, 2)):
            shared = min(len(paths[first]), len(paths[second]))
            apart = np.abs(paths[first][:shared, :2] - paths[second][:shared, :2]).max()
            assert apart > 0.5, (world, first, second)


def test_fixed_routes_are_the_same_for_each_seed(tmp_path):
    common = ("--duration", "4", "--format", "parquet", "--count", "2")
    assert call("simulate", "office", "--route", "fixed", "--out", tmp_path, *common) == 0
    first, second = open_collection(tmp_path)
    np.testing.assert_array_equal(first.truth, second.truth)
    assert np.abs(first.odometry - second.odometry).max() > 0.0


def test_variants_of_one_drive_have_the_same_path(tmp_path):
    common = ("--duration", "5", "--format", "parquet", "--seed", "3")
    varied = ("--vary", "clutter=0,3", "--vary", "lidar=lds01,rplidar_a2")
    assert call("simulate", "office", "--out", tmp_path, *common, *varied) == 0
    worlds = {(path / "world.toml").read_bytes() for path in datasets_in(tmp_path)}
    assert len(worlds) == 2
    ends = [open_dataset(path).table.truth[-1] for path in datasets_in(tmp_path)]
    np.testing.assert_array_equal(ends, [ends[0]] * 4)


def test_arrays_are_the_frames(made):
    dataset = open_dataset(made / "office-0001")
    frames = open_log(made / "office-0001").frames
    scans = [frame for frame in frames if frame.scan is not None]
    np.testing.assert_array_equal(dataset.scans, [frame.scan.ranges for frame in scans])
    np.testing.assert_array_equal(dataset.angles, [frame.scan.angles for frame in scans])
    np.testing.assert_array_equal(dataset.time_offsets, [frame.scan.time_offsets for frame in scans])
    for name in ("odometry", "truth", "twist", "command"):
        np.testing.assert_array_equal(getattr(dataset, name), [getattr(frame, name) for frame in scans])
    np.testing.assert_array_equal(dataset.stamps, [frame.stamp for frame in scans])
    assert [frame.stamp for frame in dataset] == [frame.stamp for frame in frames]
    assert (dataset.mount, len(dataset)) == (scans[0].scan.mount, len(scans))
    assert dataset.range_limits == (scans[0].scan.range_min, scans[0].scan.range_max)
    np.testing.assert_allclose(read_tum(made / "office-0001" / "truth.tum").poses, dataset.truth, atol=1e-9)
    assert dataset.truth_map.occupied.any()


def test_a_slice_of_time_is_those_scans(made):
    dataset = open_dataset(made / "office-0001")
    part = dataset.between(1.0, 3.0)
    inside = (dataset.stamps >= 1.0) & (dataset.stamps < 3.0)
    assert 0 < inside.sum() < len(dataset)
    np.testing.assert_array_equal(part.scans, dataset.scans[inside])
    np.testing.assert_array_equal(part.truth, dataset.truth[inside])


def test_scans_with_varying_beams_are_padded(tmp_path):
    common = ("--duration", "3", "--format", "rosbag2-lean", "--out", tmp_path)
    assert call("simulate", "office", "--lidar", "rplidar_a1", *common) == 0
    (path,) = datasets_in(tmp_path)
    dataset = open_dataset(path)
    scans = [frame.scan for frame in open_log(path).frames if frame.scan is not None]
    assert dataset.scans.shape == (len(scans), max(scan.ranges.size for scan in scans))
    for row, angles, scan in zip(dataset.scans, dataset.angles, scans, strict=True):
        count = scan.ranges.size
        np.testing.assert_array_equal(row[:count], scan.ranges)
        np.testing.assert_array_equal(angles[:count], scan.angles)
        assert np.isnan(row[count:]).all()
        assert np.isnan(angles[count:]).all()


def test_pandas_has_a_row_for_each_frame(made):
    pytest.importorskip("pandas")
    dataset = open_dataset(made / "loop-0002")
    table = dataset.to_pandas()
    assert len(table) == len(dataset.table)
    scans = table[table.lidar.notna()]
    np.testing.assert_array_equal(np.stack(scans.ranges.to_list()), dataset.scans)
    np.testing.assert_array_equal(scans[["truth_x", "truth_y", "truth_theta"]], dataset.truth)
    index = open_collection(made).to_pandas()
    assert list(index.columns) == list(COLUMNS)


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


def test_each_lidar_is_dealt_equally_often():
    draw = Draw.parse("lidar=lds01,lds02,rplidar_a2")
    for world in ("office", "loop"):
        for first in (0, 3, 30):
            assert len({draw.value(world, seed) for seed in range(first, first + 3)}) == 3
    generated = [draw.value(f"generated:rooms:{seed}", 0) for seed in range(30)]
    assert {generated.count(lidar) for lidar in draw.choices} == {10}
    assert len({tuple(generated[k : k + 3]) for k in range(0, 30, 3)}) > 2


def test_datasets_are_in_the_order_of_their_numbers(made, tmp_path):
    for name in ("rooms-10-0000", "rooms-2-0000", "rooms-2-0011", "office-0000"):
        shutil.copytree(made / "loop-0000", tmp_path / name)
    names = [path.name for path in datasets_in(tmp_path)]
    assert names == ["office-0000", "rooms-2-0000", "rooms-2-0011", "rooms-10-0000"]


def test_a_choice_without_datasets_is_a_warning(made, tmp_path):
    collection = open_collection(made)
    with pytest.warns(UserWarning, match="no dataset has lidar lds1, only lds01, rplidar_a2"):
        assert len(collection.where(lidar="lds1")) == 0
    with pytest.warns(UserWarning, match="no dataset has world loop and seed 7|no dataset has seed 7, only 0, 1, 2"):
        collection.where(world="loop", seed=7)
    for name in ("loop-0000", "loop-0001"):
        shutil.copytree(made / name, tmp_path / name)
    assert call("datasets", "index", tmp_path) == 0
    with pytest.warns(UserWarning, match="only train. Nothing for validation and test: there is one world"):
        open_collection(tmp_path).split("test")


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


def test_a_plan_makes_nothing(tmp_path, capsys):
    out = tmp_path / "data"
    arguments = ("office,loop", "--count", "3", "--duration", "4", "--format", "parquet", "--out", out, *DRAWS)
    assert call("simulate", *arguments, "--plan") == 0
    output = capsys.readouterr().out
    assert f"{out}: 6 datasets to make\n" in output
    assert "0.01 h of driving" in output  # 6 x 4 s
    assert not out.exists()
    assert call("simulate", *arguments) == 0
    planned = float(re.search(r"about (\d+) MB", output).group(1))
    assert planned == pytest.approx(open_collection(out).totals()["bytes"] / 1e6, rel=0.3, abs=1.0)
    capsys.readouterr()
    assert call("simulate", *arguments, "--plan") == 0
    assert "0 datasets to make; 6 exist already" in capsys.readouterr().out


def test_the_index_is_the_same_again(made):
    before = (made / "datasets.parquet").read_bytes()
    write_index(made)
    assert (made / "datasets.parquet").read_bytes() == before


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


def test_worlds_without_a_comma_are_refused_with_advice(tmp_path, capsys):
    assert_refused(capsys, "unexpected lab; several worlds", "simulate", "office", "lab", "--out", tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_a_dataset_of_other_settings_is_not_kept_silently(made, tmp_path, capsys):
    out = tmp_path / "data"
    shutil.copytree(made, out)
    before = {file: file.read_bytes() for file in out.iterdir() if file.is_file()}
    common = ("office", "--out", out, "--duration", "6", "--seed", "1")
    for options, complaint in (
        (("--format", "parquet", "--lidar", "lds02"), "this command wants lidar lds02; choose another --out"),
        (("--format", "rosbag2", *DRAWS), "office-0001: has format parquet, this command wants format rosbag2"),
        (("--format", "parquet", *DRAWS, "--odometry.grade", "poor"), "has odometry.grade typical, this command wants"),
    ):
        assert_refused(capsys, complaint, "simulate", *common, *options)
    assert {file: file.read_bytes() for file in out.iterdir() if file.is_file()} == before
    assert call("simulate", *common, "--format", "parquet", *DRAWS) == 0
    assert "1 existed already" in capsys.readouterr().out


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


def test_info_prints_the_totals(made, capsys):
    assert call("datasets", "info", made, "--json") == 0
    totals = json.loads(capsys.readouterr().out)
    licence = totals.pop("licence")
    assert (licence, totals.pop("splits_chosen")) == ("CC-BY-4.0", False)
    assert totals == open_collection(made).totals()
    named = {split: {row["world"] for row in open_collection(made).rows if row["split"] == split} for split in SPLITS}
    assert {split: set(worlds) for split, worlds in totals["split_worlds"].items()} == named
    assert call("datasets", "info", made) == 0
    output = capsys.readouterr().out
    assert re.search(r"lds01 +\d +\d +\d\nrplidar_a2 +\d +\d +\d\n", output)
    assert "share at most" in output
    for split, worlds in named.items():
        assert re.search(rf"^{split} .* {', '.join(sorted(worlds))} *$", output, re.MULTILINE)
    assert "the splits come from a hash" in output


def test_shards_make_the_same_datasets(made, tmp_path):
    common = ("--duration", "6", "--format", "parquet", "--out", tmp_path)
    for shard in ("0/2", "1/2"):
        arguments = ("office,loop,generated:maze:1", "--count", "3", *DRAWS, *common)
        assert call("simulate", *arguments, "--shard", shard) == 0
    assert (tmp_path / "datasets.parquet").read_bytes() == (made / "datasets.parquet").read_bytes()
    for path in datasets_in(made):
        assert (tmp_path / path.name / "config.toml").read_bytes() == (path / "config.toml").read_bytes()


def test_a_drawn_dataset_is_made_again_from_its_config(made, tmp_path):
    again = made / "office-0002" / "config.toml"
    assert call("simulate", "--config", again, "--out", tmp_path) == 0
    files = sorted(path.name for path in (made / "office-0002").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "office-0002").iterdir())
    for name in files:
        assert (tmp_path / "office-0002" / name).read_bytes() == (made / "office-0002" / name).read_bytes(), name


def test_a_collection_is_no_dataset(made):
    with pytest.raises(LogError, match=r"holds 9 datasets; name one, such as .*loop-0000, or .* open_collection"):
        open_dataset(made)


def test_a_recording_without_settings_has_a_repr(made, tmp_path):
    (tmp_path / "config.toml").write_text("")
    assert repr(open_dataset(tmp_path)) == f"<Dataset {tmp_path.name!r}: not read yet>"


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


def test_one_dataset_is_no_collection(made):
    with pytest.raises(LogError, match="use open_dataset"):
        open_collection(made / "office-0002")


def test_a_value_that_is_given_again_is_no_draw(made, tmp_path):
    again = made / "office-0002" / "config.toml"
    assert call("simulate", "--config", again, "--noise", "1.5", "--duration", "1", "--out", tmp_path) == 0
    draws = tomllib.loads((tmp_path / "office-0002" / "config.toml").read_text())["draws"]
    assert set(draws) == {"lidar"}


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--draw", "speed=1..2"), "expected KEY=A,B or KEY=LOW..HIGH with a key of robot, lidar"),
        (("--draw", "noise=2..1"), "the lower one first"),
        (("--draw", "noise=a..b"), "expected two numbers"),
        (("--draw", "odometry.grade=good,superb"), "--draw odometry.grade=superb"),
        (("--draw", "lidar=lds01,rplidar"), "--draw lidar=rplidar: unknown lidar 'rplidar'"),
        (("--vary", "lidar=lds01,rplidar"), "--vary lidar=rplidar: unknown lidar 'rplidar'"),
        (("--draw", "robot=create3,dingo_d"), "robot 'dingo_d' does not fit"),
        (("--draw", "noise=1..2", "--draw", "noise=3,4"), "names a key twice"),
        (("--draw", "noise=1..2", "--vary", "noise=1,2"), "given to --vary and --draw"),
        (("--shard", "2/2"), "shard 2/2: expected 0/2 to 1/2"),
        (("--seed", "-1"), "seed must not be negative"),
    ],
)
def test_bad_requests_are_refused_before_anything_is_made(tmp_path, capsys, options, complaint):
    out = tmp_path / "data"
    assert_refused(capsys, complaint, "simulate", "office", "--out", out, *options)
    assert not out.exists()


def test_one_dataset_is_a_collection_without_an_index(made, tmp_path):
    shutil.copytree(made / "loop-0000", tmp_path / "loop-0000")
    (row,) = open_collection(tmp_path).rows
    assert row == next(row for row in open_collection(made).rows if row["dataset"] == "loop-0000") | {
        "split": "train",
        "overlap": None,
        "same_places": None,
    }


def test_what_is_no_collection_is_refused(made, tmp_path):
    with pytest.raises(LogError, match=r"no datasets\.parquet; `testbed datasets index"):
        open_collection(tmp_path)
    shutil.copy(made / "datasets.parquet", tmp_path)
    with pytest.raises(LogError, match=r"the index names .* which is not there"):
        open_collection(tmp_path)
    (tmp_path / "datasets.parquet").write_bytes(b"PAR1 and so on")
    with pytest.raises(LogError, match=r"datasets\.parquet: damaged"):
        open_collection(tmp_path)
    with pytest.raises(LogError, match="no such file"):
        open_dataset(tmp_path / "nothing")


def test_reprs_are_one_line(made):
    collection = open_collection(made)
    dataset = collection[0]
    assert repr(dataset).endswith("create3, lds01, 6.0 s, not read yet>") or "rplidar_a2, 6.0 s" in repr(dataset)
    _ = dataset.scans
    for shown in (collection, dataset, dataset.log, next(iter(dataset))):
        assert len(repr(shown)) < 150
        assert "\n" not in repr(shown)


def test_the_code_of_the_docs_runs(made, monkeypatch, capsys):
    pytest.importorskip("pandas")
    text = (Path(__file__).parents[3] / "docs" / "datasets.md").read_text()
    monkeypatch.chdir(made.parent)
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 5
    assert call("convert", made / "office-0001", made.parent / "bag", "--to", "rosbag2") == 0
    for block in blocks:
        exec(block.replace('Path("data/office-0001")', 'Path("bag")'), {})
    assert "predicting no motion" in capsys.readouterr().out
