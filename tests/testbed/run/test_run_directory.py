# SPDX-License-Identifier: MIT
"""The run directory: nothing is lost by mistake, nothing looks finished that is not."""

import errno
import json
import tomllib
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from testbed.run.run_directory import RUN_FILES, RunDirectory, RunDirectoryError, default_directory, result_hash

TRAJECTORY = Trajectory(np.arange(3.0), np.arange(9.0).reshape(3, 3) / 10)
GRID = OccupancyGrid(
    probability=np.array([[0.0, np.nan], [1.0, 0.3]], dtype=np.float32), resolution=0.05, origin=(0.0, 0.0, 0.0)
)


def test_a_new_directory_is_made_with_its_parents(tmp_path):
    directory = RunDirectory.create(tmp_path / "a" / "b")
    assert directory.path.is_dir()


def test_a_directory_with_anything_in_it_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(RunDirectoryError, match="not empty"):
        RunDirectory.create(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_file_is_no_directory(tmp_path):
    path = tmp_path / "run"
    path.write_text("")
    with pytest.raises(RunDirectoryError, match="is a file"):
        RunDirectory.create(path, overwrite=True)


def test_overwrite_removes_the_old_run_and_nothing_else(tmp_path):
    for name in (*RUN_FILES, "notes.txt"):
        (tmp_path / name).write_text("old")
    RunDirectory.create(tmp_path, overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_overwrite_removes_the_metrics_first(tmp_path, monkeypatch):
    """A crash in the middle must not leave an old metrics.json that makes a mixture look finished."""
    for name in RUN_FILES:
        (tmp_path / name).write_text("old")
    removed = []
    monkeypatch.setattr(Path, "unlink", lambda self, missing_ok=False: removed.append(self.name))
    RunDirectory.create(tmp_path, overwrite=True)
    assert removed[0] == "metrics.json"


def test_only_known_files_can_be_written(tmp_path):
    with pytest.raises(RunDirectoryError, match="no file of a run"):
        _ = RunDirectory(tmp_path) / "../escape"


def test_config_reads_back_without_what_is_none(tmp_path):
    directory = RunDirectory.create(tmp_path)
    directory.write_config({"settings": {"seed": 3, "duration": None, "log": Path("/x/y"), "filter": {"a": 0.1}}})
    read = tomllib.loads((tmp_path / "config.toml").read_text())
    assert read == {"settings": {"seed": 3, "log": "/x/y", "filter": {"a": 0.1}}}


def test_a_full_disk_leaves_the_old_file_or_none(tmp_path, monkeypatch):
    directory = RunDirectory.create(tmp_path)
    directory.write_metrics({"outcome": "ok"})

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space left"):
        directory.write_metrics({"outcome": "other"})
    with pytest.raises(OSError, match=r"No space left.*config\.toml'"):  # not the name it has meanwhile
        directory.write_config({})
    assert [p.name for p in tmp_path.iterdir()] == ["metrics.json"]
    assert json.loads((tmp_path / "metrics.json").read_bytes()) == {"outcome": "ok"}


@pytest.mark.parametrize(("error", "outcome"), [(KeyboardInterrupt, "interrupted"), (ValueError, "failed")])
def test_what_is_cut_off_is_marked_beside_what_is_known(tmp_path, error, outcome):
    directory = RunDirectory.create(tmp_path)
    with pytest.raises(error), directory.marked({"outcome": "ok", "scans": 7}):
        raise error("so it\nwas")
    read = json.loads((tmp_path / "metrics.json").read_text())
    assert read == {"outcome": outcome, "reason": "so it was", "scans": 7}


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (KeyboardInterrupt(), "the run was stopped by hand while the kernels were compiled"),
        (MemoryError(), "the run ended with MemoryError while the kernels were compiled"),
    ],
)
def test_a_run_that_is_cut_off_has_a_reason_in_words(tmp_path, error, reason):
    with pytest.raises(type(error)), RunDirectory.create(tmp_path).marked(stage="the kernels were compiled"):
        raise error
    assert json.loads((tmp_path / "metrics.json").read_text())["reason"] == reason


def test_a_run_that_cannot_even_be_marked_does_not_look_finished(tmp_path, monkeypatch):
    directory = RunDirectory.create(tmp_path)
    directory.write_metrics({"outcome": "ok"})

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match=r"report\.html"), directory.marked({"outcome": "ok"}):
        raise OSError(errno.ENOSPC, "No space left on device", "report.html")
    assert list(tmp_path.iterdir()) == []


def test_default_directories_never_collide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    now = datetime(2025, 1, 1, 12, 0, 0)
    made = []
    for _ in range(3):
        made.append(default_directory("office", now))
        made[-1].mkdir(parents=True)
    assert [p.name for p in made] == ["office-20250101-120000", "office-20250101-120000-2", "office-20250101-120000-3"]


def test_result_hash_knows_bits_and_nothing_else():
    same = OccupancyGrid(probability=GRID.probability.copy(), resolution=0.05, origin=(0.0, 0.0, 0.0))
    same.probability[0, 1] = -np.float32("nan")  # another NaN is still "unknown"
    assert result_hash(TRAJECTORY, same) == result_hash(TRAJECTORY, GRID)


@pytest.mark.parametrize(
    "changed",
    [
        (Trajectory(TRAJECTORY.stamps, np.nextafter(TRAJECTORY.poses, 9.0)), GRID),
        (Trajectory(TRAJECTORY.stamps + 1.0, TRAJECTORY.poses), GRID),
        (TRAJECTORY, OccupancyGrid(probability=GRID.probability, resolution=0.1, origin=GRID.origin)),
        (TRAJECTORY, OccupancyGrid(probability=GRID.probability.T.copy(), resolution=0.05, origin=GRID.origin)),
        (TRAJECTORY, OccupancyGrid(probability=GRID.probability.reshape(1, 4), resolution=0.05, origin=GRID.origin)),
    ],
)
def test_result_hash_changes_with_any_bit(changed):
    assert result_hash(*changed) != result_hash(TRAJECTORY, GRID)
