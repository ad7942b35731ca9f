# SPDX-License-Identifier: MIT
"""`--system` of `run` and `slam`: the same frames for all, a run directory each, and failures that stay alone."""

import json
import tomllib

import numpy as np
import pytest

from eval.files.tum import read_tum
from testbed.views import recording_of
from testbed.views.rerun import entities
from tests.cheaper import undrawn
from tests.shell import assert_refused, call
from tests.testbed.cli.test_cli import room_log
from tests.testbed.views.shown_map import rows

pytestmark = pytest.mark.usefixtures("without_pictures")
SYSTEM = """
class Base:
    name, version = "mine", "1"
    def start(self, lidars, seed): pass
    def process(self, frame): return frame.odometry
    def finish(self): return None, None

class Failing(Base):
    def process(self, frame):
        if frame.stamp > 2.0:
            raise ValueError("no wall in sight")
"""
DRIVE = ("run", "office", "--backend", "fast", "--duration", "6", "--particles", "3")


def metrics_of(path):
    return json.loads((path / "metrics.json").read_text())


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """A run without --system, and the same drive with three systems."""
    out = tmp_path_factory.mktemp("compared")
    with undrawn():
        assert call(*DRIVE, "--out", out / "default") == 0
        assert call(*DRIVE, "--system", "gmapping,odometry,scan-matching", "--out", out / "all") == 0
    return out


def test_our_filter_as_a_system_gives_the_same_bits(compared):
    default, system = compared / "default", compared / "all" / "gmapping"
    for name in ("estimate.tum", "estimate_dense.tum", "online.tum", "odometry.tum", "truth.tum", "map.pgm"):
        assert (system / name).read_bytes() == (default / name).read_bytes(), name
    ours, theirs = metrics_of(default), metrics_of(system)
    assert theirs["result_hash"] == ours["result_hash"]
    for group in ("trajectory", "trajectory_online", "map", "outcome", "outcome_online", "scans", "duration_s"):
        assert theirs[group] == ours[group], group


def test_all_systems_see_one_drive(compared):
    folders = [compared / "all" / name for name in ("gmapping", "odometry", "scan-matching")]
    assert len({(folder / "truth.tum").read_bytes() for folder in folders}) == 1
    assert len({(folder / "truth_map.pgm").read_bytes() for folder in folders}) == 1
    odometry = folders[1]
    assert (odometry / "estimate.tum").read_bytes() == (odometry / "odometry.tum").read_bytes()
    assert not (odometry / "map.yaml").exists()
    assert (
        metrics_of(odometry)["trajectory"]["ate_rmse_m"] == metrics_of(odometry)["trajectory"]["odometry"]["ate_rmse_m"]
    )


def test_the_recording_holds_all_systems_in_the_frame_of_the_truth(compared):
    recording = recording_of(compared / "all")
    assert recording is not None
    truth = rows(recording, entities.TRUE_ROBOT, "Transform3D:translation")
    for name in ("gmapping", "odometry", "scan-matching"):
        robot = rows(recording, f"{entities.SYSTEMS}/{name}/robot", "Transform3D:translation")
        apart = np.array([value[0][:2] for _, value in robot]) - [value[0][:2] for _, value in truth]
        rmse = metrics_of(compared / "all" / name)["trajectory"]["ate_rmse_m"]
        assert np.sqrt((apart**2).sum(axis=1).mean()) == pytest.approx(rmse, abs=1e-5)
        errors = rows(recording, f"{entities.POSITION_ERROR}/{name}", "Scalars:scalars")
        assert np.sqrt(np.mean([value[0] ** 2 for _, value in errors])) == pytest.approx(rmse, abs=1e-5)
    assert rows(recording, f"{entities.SYSTEMS}/gmapping/map", "GridMap:translation", static=True)
    assert not rows(recording, f"{entities.SYSTEMS}/odometry/map", "GridMap:translation", static=True)


def test_scoring_against_the_directory_of_all_names_one_of_them(compared, capsys):
    mine = compared / "default" / "estimate.tum"
    assert_refused(
        capsys, f"did you mean {compared / 'all' / 'gmapping'}?", "score", compared / "all", "--trajectory", mine
    )


def test_a_run_directory_says_which_system_made_it(compared):
    folder = compared / "all" / "scan-matching"
    config = tomllib.loads((folder / "config.toml").read_text())
    assert config["settings"]["system"] == "gmapping,odometry,scan-matching"
    assert config["system"]["name"] == "scan-matching"
    assert config["system"]["settings"]["filter"]["particles"] == 1
    cost = metrics_of(folder)["system"]
    assert cost["name"] == "scan-matching"
    assert cost["ms_per_scan"] > 0.0
    assert (folder / "report.html").is_file()
    assert (compared / "all" / "comparison.html").is_file()


def test_a_run_without_system_mentions_none(compared):
    config = tomllib.loads((compared / "default" / "config.toml").read_text())
    assert not [key for key in (*config, *config["settings"]) if "system" in key]
    assert "system" not in metrics_of(compared / "default")


def test_a_failing_system_leaves_the_others_alone(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(SYSTEM)
    mine, out = tmp_path / "mine.py", tmp_path / "out"
    log = room_log(tmp_path / "room.log")
    assert call("slam", log, "--system", f"{mine}:Failing,{mine}:Base", "--out", out) == 2
    captured = capsys.readouterr()
    assert (
        "testbed: Failing: scan 3 (3.000 s): process raised ValueError: no wall in sight (mine.py:11)" in captured.err
    )
    assert "Failing" in captured.out
    assert metrics_of(out / "Failing")["outcome"] == "failed"
    assert "no wall in sight" in metrics_of(out / "Failing")["reason"]
    assert metrics_of(out / "Base")["outcome"] != "failed"
    page = (out / "comparison.html").read_text()
    assert "no wall in sight" in page
    assert "1 of 2 judged runs failed" in page
    np.testing.assert_array_equal(read_tum(out / "Base" / "estimate.tum").stamps, range(5))


def test_a_class_that_hangs_is_a_failed_run(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(
        f"{SYSTEM}\nclass Hanging(Base):\n    def start(self, lidars, seed):\n        while True: pass"
    )
    log, out = room_log(tmp_path / "room.log"), tmp_path / "out"
    limited = ("--system", f"{tmp_path / 'mine.py'}:Hanging", "--system-time-limit", "0.5")
    assert call("slam", log, *limited, "--out", out) == 2
    assert "testbed: Hanging: start did not return within the time limit of 0.5 s" in capsys.readouterr().err
    assert "did not return within" in metrics_of(out / "Hanging")["reason"]


def test_a_setting_reaches_its_system(tmp_path):
    log, out = room_log(tmp_path / "room.log"), tmp_path / "out"
    options = ("--system-set", "gmapping.filter.map.cell=0.2", "--particles", "2")
    assert call("slam", log, "--system", "gmapping,scan-matching", *options, "--out", out) == 0
    assert "resolution: 0.2" in (out / "gmapping" / "map.yaml").read_text()
    assert "resolution: 0.05" in (out / "scan-matching" / "map.yaml").read_text()
    config = tomllib.loads((out / "gmapping" / "config.toml").read_text())
    assert config["system"]["settings"]["filter"]["particles"] == 2


def test_localization_is_a_system_in_a_given_map(compared, tmp_path):
    map_ = compared / "default" / "map.yaml"
    chosen = ("--system", "localization,odometry", "--system-set", f"localization.map={map_}")
    assert call(*DRIVE, *chosen, "--system-set", "localization.start=0,0,0", "--out", tmp_path / "out") == 0
    errors = {
        name: metrics_of(tmp_path / "out" / name)["trajectory"]["ate_rmse_m"] for name in ("localization", "odometry")
    }
    assert errors["localization"] < errors["odometry"]
    assert "map" not in metrics_of(tmp_path / "out" / "localization")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--system", "gmaping"], "system 'gmaping': unknown, expected one of gmapping"),
        (["--system", "gmapping,gmapping"], "gmapping: occurs twice"),
        (["--system", ","], "expected names, separated by commas"),
        (["--system", "odometry", "--view"], "--view: shows the filter of this package"),
        (["--system", "odometry", "--driver", "explore"], "--driver explore: drives by the filter of this package"),
        (["--system", "gmapping", "--system-set", "gmapping.reach=1"], "no such setting, expected one of filter"),
        (
            ["--system", "gmapping", "--system-set", "karto.reach=1"],
            "expected NAME.FIELD=VALUE with NAME one of gmapping",
        ),
        (["--system-set", "gmapping.refine=false"], "expected --system as well"),
        (["--system", "odometry", "--system-time-limit", "0"], "--system-time-limit 0: expected a positive time"),
    ],
)
def test_wrong_options_are_refused_before_the_drive(tmp_path, capsys, arguments, complaint):
    assert_refused(capsys, complaint, *DRIVE, *arguments, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_comparison_is_not_written_over_files(tmp_path, capsys):
    log, out = room_log(tmp_path / "room.log"), tmp_path / "out"
    assert call("slam", log, "--system", "odometry", "--out", out) == 0
    assert_refused(capsys, "is not empty", "slam", log, "--system", "odometry", "--out", out)
    assert call("slam", log, "--system", "odometry", "--out", out, "--overwrite") == 0
