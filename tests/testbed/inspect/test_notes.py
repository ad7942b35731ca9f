# SPDX-License-Identifier: MIT
"""What is doubtful about a recording stands in the notes of its run, and an offset of the clocks can be taken back."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from testbed.formats import Log
from testbed.formats.write import write_log
from testbed.inspect.time_offset import shifted
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from tests.shell import call
from worlds import load


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A drive whose scans are stamped 0.15 s late, with its truth."""
    config = SimulationConfig(backend="fast", duration=25.0, seeds=RunSeeds.from_seed(4))
    log = Log.from_frames(list(simulate(load("office"), config)), path=Path("drive"), format="simulation")
    path = tmp_path_factory.mktemp("late")
    write_log(path / "truth", log, "tum")
    write_log(path / "bag", replace(log, table=shifted(log.table, -0.15)[0]), "parquet")
    return path


def run_of(late, out, *options):
    common = ("--truth", late / "truth" / "truth.tum", "--particles", "5", "--out", out)
    assert call("slam", late / "bag", *common, *options) == 0
    return json.loads((out / "metrics.json").read_text())


@pytest.mark.usefixtures("without_pictures")
def test_an_offset_is_noted_and_taken_back(late, tmp_path):
    noted = run_of(late, tmp_path / "noted")
    (note,) = (note for note in noted["notes"] if note.startswith("clocks: "))
    assert "--time-offset auto takes it back" in note
    assert note in (tmp_path / "noted" / "report.html").read_text()
    mended = run_of(late, tmp_path / "mended", "--time-offset", "auto")
    assert not any(note.startswith("clocks: ") for note in mended["notes"])
    assert any("late against the odometry: taken back" in note for note in mended["notes"])
    settings = tomllib.loads((tmp_path / "mended" / "config.toml").read_text())["settings"]
    assert settings["time_offset"] == "auto"
    errors = [metrics["trajectory"]["heading_rmse_deg"] for metrics in (noted, mended)]
    assert errors[1] < 0.5 * errors[0]
