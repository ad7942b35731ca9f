# SPDX-License-Identifier: MIT
"""Collections from the command on: drives that differ, values that are drawn, shards, refusals."""

import re
import shlex
import shutil
import tomllib

import numpy as np
import pytest

from testbed.cli.shared.draws import Draw
from testbed.datasets import open_collection, open_dataset
from testbed.datasets.card import MADE_BY
from testbed.datasets.index import datasets_in
from tests.shell import assert_refused, call
from tests.testbed.datasets.small_collection import DRAWS


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


def test_each_lidar_is_dealt_equally_often():
    draw = Draw.parse("lidar=lds01,lds02,rplidar_a2")
    for world in ("office", "loop"):
        for first in (0, 3, 30):
            assert len({draw.value(world, seed) for seed in range(first, first + 3)}) == 3
    generated = [draw.value(f"generated:rooms:{seed}", 0) for seed in range(30)]
    assert {generated.count(lidar) for lidar in draw.choices} == {10}
    assert len({tuple(generated[k : k + 3]) for k in range(0, 30, 3)}) > 2


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


def test_a_plan_says_first_what_needs_no_kernels(tmp_path, capsys, monkeypatch):
    def stop():
        raise KeyboardInterrupt

    monkeypatch.setattr("testbed.cli.simulate.announce_compilation", stop)
    arguments = ("office,loop", "--count", "3", "--out", tmp_path / "data", *DRAWS)
    assert call("simulate", *arguments, "--plan") != 0
    output = capsys.readouterr().out
    assert "6 datasets to make\ntrain: office; validation: none; test: loop\n" in output
    assert "free on this disk: " in output


def test_a_missing_split_is_said_before_anything_is_made(made, tmp_path, capsys):
    common = ("--duration", "4", "--format", "parquet")
    assert call("simulate", "office", "--count", "2", "--out", tmp_path / "two", *common) == 0
    err = capsys.readouterr().err
    assert "train: office; validation: none; test: none\n(three or more worlds give all splits;" in err
    shutil.copytree(made, tmp_path / "three")
    assert call("simulate", "office", "--seed", "70", "--out", tmp_path / "three", *common) == 0
    assert "validation" not in capsys.readouterr().err


def test_worlds_without_a_comma_are_refused_with_advice(tmp_path, capsys):
    assert_refused(capsys, "unexpected lab; several worlds", "simulate", "office", "lab", "--out", tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_a_dataset_of_other_settings_is_not_kept_silently(made, tmp_path, capsys):
    out = tmp_path / "data"
    shutil.copytree(made, out)
    before = {file: file.read_bytes() for file in out.iterdir() if file.is_file()}
    common = ("office", "--out", out, "--duration", "6", "--seed", "1")
    for options, complaint in (
        (("--format", "parquet", "--lidar", "lds02"), "this command wants lidar lds02, has noise "),
        (("--format", "rosbag2", *DRAWS), "wants format rosbag2; repeat --format parquet, or choose another --out"),
        (
            ("--format", "parquet", *DRAWS, "--odometry.grade", "poor"),
            "has odometry.grade typical, this command wants odometry.grade poor; repeat --odometry.grade typical, or",
        ),
        (("--format", "parquet", *DRAWS, "--compress"), "wants compress True; choose another --out"),
    ):
        assert_refused(capsys, complaint, "simulate", *common, *options)
    assert {file: file.read_bytes() for file in out.iterdir() if file.is_file()} == before
    assert call("simulate", *common, "--format", "parquet", *DRAWS) == 0
    assert "1 existed already" in capsys.readouterr().out


def test_the_draws_of_the_card_are_to_be_repeated(made, tmp_path, capsys):
    """Where they give the value that is there: another command of the card, or somebody's edit, may give another."""
    out = tmp_path / "data"
    shutil.copytree(made, out)
    begin = (out / "README.md").read_text().partition(MADE_BY)[0]
    common = ("office", "--out", out, "--duration", "6", "--seed", "1", "--format", "parquet", "--lidar", "lds02")
    for noise, shown in (("0.5..2", "0.5..2"), ("1..2", "…"), ("much", "…"), ("0.5..2 --draw noise=1..2", "0.5..2")):
        commands = f"testbed simulate 'office\ntestbed simulate office {DRAWS[0]} {DRAWS[1]} --draw noise={noise}"
        (out / "README.md").write_text(f"{begin}{MADE_BY}{commands}\n```\n")
        complaint = f"this command wants noise 1.0; repeat {shlex.join(DRAWS[:2])} --draw noise={shown}, or choose"
        assert_refused(capsys, complaint, "simulate", *common)


def test_what_was_not_drawn_is_to_be_given_again_instead_of_drawn(tmp_path, capsys):
    common = ("loop", "--out", tmp_path, "--duration", "0.5", "--format", "parquet")
    assert call("simulate", *common, "--lidar", "lds02") == 0
    complaint = "has lidar lds02, this command wants lidar lds01; repeat --lidar lds02 and leave out --draw lidar, or"
    assert_refused(capsys, complaint, "simulate", *common, "--draw", "lidar=lds01")


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
