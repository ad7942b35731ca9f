# SPDX-License-Identifier: MIT
"""`testbed sweep` and `testbed gather` from end to end on a room that is driven through in a few seconds."""

import json
import os
import re
import shutil
import signal
import subprocess
import time
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from eval.sweep.paper_tables import markdown_table
from eval.sweep.results import read_sweep
from eval.sweep.summary import summarise
from testbed.cli import sweep as sweep_command
from testbed.cli.shared import sweep_announcement
from testbed.cli.shared.sweep_options import SweepOptions
from testbed.sweep.errors import SweepError
from testbed.sweep.execute import check_code, prepare
from testbed.sweep.execution import dask_cluster as cluster
from testbed.sweep.spec.code_version import commit
from testbed.sweep.spec.plan import Shard, file_digest
from testbed.sweep.store import SweepDirectory
from tests.shell import TESTBED, assert_refused, call
from tests.testbed.sweep.room import room_cell, room_file

TABLES = ("sweep.parquet", "curves.parquet")
"""What must not depend on how a sweep was carried out."""


def room_sweep(world: Path) -> list[object]:
    """Arguments of a sweep of eight cells that take a tenth of a second each."""
    grid = ["--worlds", world, "--particles", "1,3", "--seeds", "2"]
    return ["sweep", *grid, "--axis", "filter.proposal.kind=improved,motion", "--set", "refine=false", "--no-worst"]


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    return room_file(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def swept(tmp_path_factory, world) -> Path:
    """The sweep by two worker processes; to be read, not changed."""
    out = tmp_path_factory.mktemp("swept") / "sweep"
    assert call(*room_sweep(world), "--workers", "2", "--out", out) == 0
    return out


@pytest.fixture(autouse=True)
def without_reports(swept, monkeypatch):
    """The sweep above has a report; drawing another one in every test would take longer than all else."""
    monkeypatch.setattr("testbed.cli.gather.write_sweep_report", lambda folder: folder / "sweep.html")


@pytest.fixture
def copied(swept, tmp_path) -> Path:
    """A copy of it that may be changed."""
    return Path(shutil.copytree(swept, tmp_path / "sweep"))


def bytes_of(out: Path) -> dict[str, bytes]:
    """Tables, and what the cells hold but their times."""
    files = [*(out / name for name in TABLES), *(out / "cells").glob("*/[!t]*.json")]
    return {str(file.relative_to(out)): file.read_bytes() for file in files}


def test_every_cell_is_a_row_and_nothing_is_left_over(swept):
    table = pq.read_table(swept / "sweep.parquet").to_pylist()
    assert [(row["line"], row["particles"], row["seed"]) for row in table] == [
        (line, particles, seed) for line in ("improved", "motion") for particles in (1, 3) for seed in (0, 1)
    ]
    assert {row["status"] for row in table} == {"done"}
    assert all(np.isfinite(row["trajectory.ate_rmse_m"]) for row in table)
    assert {path.name for path in (swept / "cells").iterdir()} == {row["key"] for row in table}
    assert (swept / "sweep.html").stat().st_size > 50_000
    assert {path.suffix for path in (swept / "figures").iterdir()} == {".svg", ".pdf"}


def test_every_column_says_what_it_holds(swept):
    columns = {}
    for name in ("sweep", "curves", "timings"):
        schema = pq.read_schema(swept / f"{name}.parquet")
        columns |= {field.name: field.metadata[b"description"].decode() for field in schema}
        assert str(schema.field("key").type) == "string"
    assert [name for name, words in columns.items() if words.startswith("The key ") or not words.endswith(".")] == []
    # a column in metres says so
    lengths = [name for name in columns if name.endswith("_m") and "_per_m" not in name]
    assert len(lengths) > 50
    assert [name for name in lengths if "[m]" not in columns[name]] == []
    assert {str(pq.read_schema(swept / "sweep.parquet").field(name).type) for name in ("family", "reason")} == {
        "string"
    }


def test_features_of_world_and_sensors_are_columns(swept):
    rows = pq.read_table(swept / "sweep.parquet").to_pylist()
    assert {row["features.area_m2"] for row in rows} == {19.8}  # 5 m x 4 m without the pillar
    assert {row["features.odometry_grade"] for row in rows} == {"typical"}


def test_all_counts_and_variants_of_a_seed_get_the_same_data(swept):
    table = pq.read_table(swept / "sweep.parquet").to_pylist()
    odometry = {
        seed: {row["trajectory.odometry.ate_rmse_m"] for row in table if row["seed"] == seed} for seed in (0, 1)
    }
    assert [len(errors) for errors in odometry.values()] == [1, 1]
    assert odometry[0] != odometry[1]


@pytest.mark.usefixtures("without_pictures")
def test_a_cell_gives_what_testbed_run_gives(swept, world, tmp_path):
    options = ["--backend", "fast", "--seed", "1", "--particles", "3", "--no-refine", "--route", "random"]
    assert call("run", world, *options, "--filter.proposal.kind", "motion", "--out", tmp_path / "run") == 0
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    rows = pq.read_table(swept / "sweep.parquet").to_pylist()
    (row,) = (row for row in rows if (row["line"], row["particles"], row["seed"]) == ("motion", 3, 1))
    assert row["result_hash"] == metrics["result_hash"]
    for estimate in ("trajectory_online", "trajectory_filter", "trajectory"):
        assert row[f"{estimate}.ate_rmse_m"] == metrics[estimate]["ate_rmse_m"]
    assert row["map_filter.wall_distance_m"] == metrics["map_filter"]["wall_distance_m"]
    assert "map.best_rigid.iou" not in row  # left out of sweeps, since it would take most of the time of scoring


@pytest.mark.usefixtures("in_this_process")
def test_shards_give_the_bytes_of_the_single_sweep(swept, world, tmp_path, capsys):
    out = tmp_path / "sharded"
    assert call(*room_sweep(world), "--workers", "1", "--shard", "0/2", "--out", out) == 0
    capsys.readouterr()
    assert call("gather", out, "--no-worst") == 1
    said = capsys.readouterr()
    assert said.err.count("missing: room, ") == 4
    assert "4 jobs done, 0 failed, 4 missing" in said.out
    assert call(*room_sweep(world), "--workers", "1", "--shard", "1/2", "--out", out) == 0
    assert call("gather", out, "--no-worst") == 0
    assert bytes_of(out) == bytes_of(swept)


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_that_was_killed_goes_on_where_it_was(swept, copied, world):
    cells = sorted((copied / "cells").iterdir())
    shutil.rmtree(cells[0])
    shutil.rmtree(cells[5])
    half_written = copied / "cells" / f".{cells[0].name}.1.tmp"
    half_written.mkdir()
    (half_written / "cell.json").write_text("{")
    before = {cell: cell.stat().st_mtime_ns for cell in cells if cell.exists()}
    assert call("sweep", "--out", copied, "--no-worst", "--workers", "1") == 0
    assert {cell: cell.stat().st_mtime_ns for cell in before} == before  # nothing was computed twice
    assert not half_written.exists()
    assert bytes_of(copied) == bytes_of(swept)


def test_jobs_over_the_limit_fail_and_are_tried_again(swept, copied, capsys):
    cells = [cell.key for cell in SweepDirectory.open(copied).manifest.cells()]
    for key in cells[:2]:
        shutil.rmtree(copied / "cells" / key)
    assert call("sweep", "--out", copied, "--no-worst", "--time-limit", "0.05") == 1
    said = capsys.readouterr()
    assert said.err.count("time limit of 0.05 s") == 4  # as it happens, and at the end
    assert "6 jobs done, 2 failed, 0 missing" in said.out
    rows = {row["key"]: row for row in pq.read_table(copied / "sweep.parquet").to_pylist()}
    assert [rows[key]["reason"] for key in cells[:2]] == ["time limit of 0.05 s"] * 2
    assert call("sweep", "--out", copied, "--no-worst") == 0
    assert list((copied / "failed").iterdir()) == []
    assert bytes_of(copied) == bytes_of(swept)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "expected --worlds, a file, --preset, or --out with the directory of a sweep"),
        (["--worlds", "ofice"], "office"),
        (["--worlds", "office", "--particles", "1,many"], "--particles 1,many: expected whole numbers"),
        (["--worlds", "office", "--axis", "robt=burger"], "robt: unknown setting, expected such as robot"),
        (["--worlds", "office", "--axis", "robot=burgr"], "burger"),
        (["--worlds", "office", "--axis", "robot="], "axis robot: is empty"),
        (["--worlds", "office", "--seeds", "100000000"], "seeds: 100000000 seeds, expected 1 to 10000"),
        (["--worlds", "office", "--seeds", "0:many"], "expected a number of seeds such as 10"),
        (["--worlds", "generated:rooms*100000"], "expected a number of worlds from 1 to 1000"),
        (["--worlds", "office", "--measure", "accuracy"], "expected one of online, filter, refined"),
        (["--worlds", "office", "--until", "decided", "--shard", "0/2"], "--shard and --until: expected one of them"),
        (["--worlds", "office", "--workers", "0"], "workers: 0, expected 1 to "),
        (["--worlds", "office", "--workers", "1000000"], "workers: 1000000, expected 1 to "),
        (["--worlds", "office", "--shard", "4/4"], "shard 4/4: expected 0/4 to 3/4"),
        (["--worlds", "office", "--time-limit", "0"], "time limit must be positive"),
        (["--preset", "partcles"], "expected one of experiment, experiment-long, experiment-test, gate"),
        (["nowhere.toml"], "nowhere.toml: no such file"),
    ],
)
def test_bad_usage_is_one_line_and_leaves_no_directory(tmp_path, monkeypatch, capsys, arguments, complaint):
    monkeypatch.chdir(tmp_path)
    assert_refused(capsys, complaint, "sweep", *arguments)
    assert list(tmp_path.iterdir()) == []


def test_another_sweep_in_the_directory_is_shown_as_a_difference(copied, world, capsys):
    less = [*changed_grid(world, particles="1,5"), "--out", copied]
    words = "particles 1, 3 are there, 1, 5 requested: a sweep can grow only, so name all of them and more"
    assert_refused(capsys, words, *less)
    other = ["sweep", "--out", copied, "--set", "lidar=lds01"]
    assert_refused(capsys, "setting lidar is the default there, lds01 requested: all runs of a sweep share", *other)
    assert_refused(capsys, "worlds", "sweep", "--out", copied, "--worlds", "apartment")
    (copied / "sweep.toml").unlink()
    assert_refused(capsys, "is not empty and holds no sweep", *room_sweep(world), "--out", copied)


def test_results_of_another_code_version_are_not_mixed_in(copied, world, capsys):
    manifest = copied / "sweep.toml"
    code = SweepDirectory.open(copied).manifest.code
    manifest.write_text(manifest.read_text().replace(code, "0" * 16))
    was, now = f"code version {'0' * 16}, commit {commit()}", f"code version {code}, commit {commit()}"
    assert_refused(capsys, f"was started with {was}; this is {now}: results", *room_sweep(world), "--out", copied)


def test_code_that_changes_between_two_looks_ends_the_sweep(copied, monkeypatch):
    directory = SweepDirectory.open(copied)
    check_code(directory)
    monkeypatch.setattr("testbed.sweep.execute.current_code_version", lambda: "0" * 16)
    with pytest.raises(SweepError, match=f"the code has changed while the sweep ran .*commit {commit()}"):
        check_code(directory)


def test_a_changed_world_file_is_noticed(copied, world, capsys):
    manifest = copied / "sweep.toml"
    manifest.write_text(manifest.read_text().replace(file_digest(world), "0" * 64))
    assert_refused(capsys, "room.toml: has changed since the sweep", *room_sweep(world), "--out", copied)


def test_two_processes_do_not_share_a_directory(copied, world, capsys):
    directory = SweepDirectory.open(copied)
    whole, shard = [*room_sweep(world), "--out", copied], ["--shard", "0/2"]
    with directory.locked(None):
        assert_refused(capsys, f"process {os.getpid()} on", *whole)
        assert_refused(capsys, f"process {os.getpid()} on", *whole, *shard)
    with directory.locked(Shard(0, 2)):
        assert_refused(capsys, "is working on it", *whole)
        assert_refused(capsys, f"process {os.getpid()} on", *whole, *shard)
        assert call(*whole, "--shard", "1/2") == 0
    with directory.locked(None):
        pass  # whoever had it has let go


def test_an_unreachable_scheduler_is_one_line(world, tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 0.5)
    out = ["--out", tmp_path / "out"]
    for address in ("tcp://127.0.0.1:1", "nonsense"):
        assert call(*room_sweep(world), "--scheduler", address, *out) == 2
        assert "cannot be reached" in capsys.readouterr().err.splitlines()[-1]


def test_a_plan_says_what_it_costs_and_what_it_can_tell(world, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert call("sweep", "--worlds", world, "--particles", "1,3", "--seeds", "3", "--plan") == 0
    said = capsys.readouterr().out
    assert f"6 jobs: {world}; 3 seeds (3 routes); 1, 3 particles\nMargin: " in said
    assert "That is 33 % of a usual error, about 1.5 cm" in said
    assert said.endswith("Time: some seconds.\n")
    assert "Can tell: 3 seeds cannot show that a count is enough; 8 can.\n" in said
    assert call("sweep", "--worlds", world, "--particles", "1", "--set", "duration=20", "--seeds", "3", "--plan") == 0
    assert "; 3 seeds (the first 20 s of 3 routes); 1 particle\n" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_a_plan_says_what_needs_no_kernels_before_it_compiles(tmp_path, monkeypatch, capsys):
    class CompilationError(Exception):
        pass

    def compiles():
        raise CompilationError

    monkeypatch.setattr(sweep_announcement, "is_compiled", lambda: False)
    monkeypatch.setattr(sweep_announcement, "announce_compilation", compiles)
    with pytest.raises(CompilationError):
        call("sweep", "--worlds", "apartment", "--particles", "1,30", "--seeds", "3", "--plan")
    said = capsys.readouterr()
    assert "3 seeds cannot show" in said.out
    assert "That is 33 %" in said.out
    assert "Measuring it needs the kernels, which are compiled first; Ctrl-C ends here" in said.err
    monkeypatch.setattr(sweep_command, "announce_compilation", compiles)
    with pytest.raises(CompilationError):  # the sweep itself too
        call("sweep", "--worlds", "apartment", "--particles", "1,30", "--seeds", "3", "--out", tmp_path / "out")
    assert "3 seeds cannot show" in capsys.readouterr().err


@pytest.mark.slow
def test_a_larger_plan_is_measured(capsys):
    assert (
        call("sweep", "--worlds", "apartment", "--particles", "1,3", "--seeds", "0:8", "--plan", "--workers", "2") == 0
    )
    said = capsys.readouterr().out
    assert re.search(
        r"16 jobs: apartment; 8 seeds \(8 routes\); 1, 3 particles\n"
        r"Margin: an error that is larger by up to 5 mm \(10 % where that is more\) .* That is 33 % .*\n"
        r"  Choose it .*\nCan tell: 8 seeds show a difference of \d+ to \d+ % of the error, or more\.\n  Chance of .*\n"
        r"  --until decided looks.*\n"
        r"Time: about \d+ (s|minutes) with 2 workers, estimated from the beginning of a run, "
        r"if the machine stays as busy as it is\.\n",
        said,
    )


@pytest.mark.usefixtures("in_this_process")
def test_until_decided_stops_where_the_answer_is_known(world, tmp_path, capsys):
    out = tmp_path / "sweep"
    grid = ["--worlds", world, "--particles", "2,3", "--until", "decided", "--seeds", "16", "--refine", "none"]
    assert call("sweep", *grid, "--no-worst", "--out", out) == 0
    rows = pq.read_table(out / "sweep.parquet").to_pylist()
    states = {row["seed"]: row["status"] for row in rows}
    assert [seed for seed, state in states.items() if state == "done"] == list(range(8))
    assert {state for seed, state in states.items() if seed >= 8} == {"not needed"}
    said = capsys.readouterr().err
    assert "16 jobs to the first look (8 seeds a world), at most 32 in all" in said
    assert "up to 16 seeds" in said


@pytest.mark.usefixtures("in_this_process")
def test_each_look_writes_the_page_and_says_what_it_has_shown(world, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("testbed.sweep.looks.MIN_CHANCE", 0.0)
    monkeypatch.setattr("eval.sweep.decision._state", lambda *_: "open")
    written = []
    monkeypatch.setattr(
        "testbed.cli.shared.sweep_looks.write_sweep_report", lambda f: written.append(f) or f / "x.html"
    )
    out = tmp_path / "sweep"
    grid = ["--worlds", world, "--particles", "2,3", "--until", "decided", "--seeds", "16", "--refine", "none"]
    assert call("sweep", *grid, "--no-worst", "--out", out) == 0
    printed = capsys.readouterr()
    said = " ".join(printed.err.split())
    assert written == [out]
    assert "  room, 16 routes: undecided with 16 seeds" in printed.out  # at the end
    assert re.search(r"  room, 8 routes: undecided with 8 seeds; take 3 for now.*\.\n    2 is open.*\.\n", printed.err)
    assert re.search(r"\n    2 particles are \d\.\d\d cm \w+ than 3 in the median pair of runs \[.*\.\n", printed.err)
    assert re.search(r"Next look with 16 seeds, 16 jobs, in about \d+ s; at most 16 jobs and about \d+ s in all", said)
    assert said.count("Looked at the results") == 1  # after the last look the page of the whole sweep follows


def test_another_margin_is_recorded_with_the_seeds_that_were_seen(copied, capsys):
    """It changes no run; going back is recorded too."""
    before = read_sweep(copied)
    assert before.margin_changes == ()
    for margin in ("2mm", "2mm", "10%,5mm"):
        assert call("sweep", "--out", copied, "--margin", margin, "--no-worst") == 0
    changes = tomllib.loads((copied / "sweep.toml").read_text())["margin_changes"]
    seeds = len(before.seeds)
    assert changes == [
        {"before": "", "margin": "2mm", "seeds": seeds},
        {"before": "2mm", "margin": "10%,5mm", "seeds": seeds},
    ]
    assert [change.margin for change in read_sweep(copied).margin_changes] == ["2mm", "10%,5mm"]
    assert {row["status"] for row in pq.read_table(copied / "sweep.parquet").to_pylist()} == {"done"}


def test_damaged_cells_and_directories_are_named(copied, tmp_path, capsys):
    assert_refused(capsys, "expected the directory of a sweep", "gather", tmp_path / "nowhere")
    cell = next((copied / "cells").iterdir())
    (cell / "metrics.json").write_text("{")
    assert_refused(capsys, f"{cell}: ", "gather", copied)


def test_a_result_of_two_processes_is_kept_once(copied):
    directory = SweepDirectory.open(copied)
    cell = directory.manifest.cells()[0]
    result = directory.result(cell.key)
    assert result is not None
    directory.keep(cell, result)
    assert directory.result(cell.key) == result
    assert all(len(path.name) == 20 for path in (copied / "cells").iterdir())


def test_a_worker_refuses_cells_of_another_code_version(world):
    from testbed.sweep.execution.worker_process import CellFailedError, Limits, WorkerProcess

    worker = WorkerProcess(Limits())
    try:
        with pytest.raises(CellFailedError, match="code version"):
            worker.compute(room_cell(world, code="0" * 16))
        with pytest.raises(CellFailedError, match="has changed since the sweep was planned"):
            worker.compute(room_cell(world, inputs={str(world): "0" * 64}))
    finally:
        worker.stop()


@pytest.mark.slow
def test_the_worst_runs_are_repeated_with_report_and_recording(copied, monkeypatch, capsys):
    monkeypatch.undo()
    assert call("gather", copied) == 0
    assert not (copied / "worst").exists()  # none of them failed
    monkeypatch.setattr("eval.sweep.summary.UNUSUAL", 0.0)
    assert call("gather", copied) == 0
    assert "differently" not in capsys.readouterr().err
    rows = {row["key"]: row for row in pq.read_table(copied / "sweep.parquet").to_pylist()}
    recorded = {path.name: path for path in (copied / "worst").iterdir()}
    assert {rows[key]["line"] for key in recorded} == {"improved", "motion"}
    page = (copied / "sweep.html").read_text()
    for key, path in recorded.items():
        assert json.loads((path / "metrics.json").read_text())["result_hash"] == rows[key]["result_hash"]
        assert (path / "recording.rrd").stat().st_size > 10_000
        assert f'href="worst/{key}/report.html"' in page
        assert f'href="worst/{key}/recording.rrd"' in page
    assert call("run", "--config", path / "config.toml", "--out", copied / "again") == 0
    assert json.loads((copied / "again" / "metrics.json").read_text())["result_hash"] == rows[key]["result_hash"]


@pytest.mark.slow
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_stopped_sweep_leaves_no_process_and_no_half_cell(world, swept, tmp_path, sign):
    out = tmp_path / "sweep"
    arguments = [*map(str, room_sweep(world)), "--workers", "2", "--out", str(out)]
    process = subprocess.Popen([*TESTBED, *map(str, arguments)], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while not any((out / "cells").glob("[!.]*")) and time.monotonic() < deadline:
        time.sleep(0.01)
    workers = children_of(process.pid)
    assert len(workers) == 2
    process.send_signal(sign)
    _, said = process.communicate(timeout=30.0)
    if sign != signal.SIGKILL:
        assert process.returncode == 130
        assert f"testbed sweep --out {out} continues with them" in said
        assert (out / "sweep.html").is_file()
    while any(map(is_running, workers)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(is_running, workers))
    assert len(list((out / "cells").glob("[!.]*"))) < 8
    assert call("sweep", "--out", out, "--no-worst") == 0
    assert bytes_of(out) == bytes_of(swept)


def children_of(pid: int) -> list[int]:
    return [
        int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()
    ]


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def changed_grid(world: Path, **options: str) -> list[object]:
    """The arguments of `room_sweep` with other values of some options."""
    words = list(map(str, room_sweep(world)))
    for name, value in options.items():
        words[words.index(f"--{name}") + 1] = value
    return words


@pytest.mark.usefixtures("in_this_process")
def test_more_seeds_and_counts_extend_a_sweep(world, copied, capsys):
    before = {cell.name: (cell / "timing.json").read_bytes() for cell in (copied / "cells").iterdir()}
    larger = changed_grid(world, seeds="3", particles="1,2,3")
    assert call(*larger, "--plan", "--out", copied) == 0
    assert "10 jobs (8 of 18 are done)" in capsys.readouterr().out
    assert call(*larger, "--out", copied) == 0
    assert {name: (copied / "cells" / name / "timing.json").read_bytes() for name in before} == before
    rows = pq.read_table(copied / "sweep.parquet").to_pylist()
    assert [row["status"] for row in rows] == ["done"] * 18
    assert {row["seed"] for row in rows} == {0, 1, 2}


@pytest.mark.usefixtures("in_this_process")
def test_a_larger_count_repeats_no_run_with_the_final_pass(world, tmp_path, capsys):
    out = tmp_path / "sweep"
    assert call("sweep", "--worlds", world, "--particles", "1,2", "--seeds", "1", "--no-worst", "--out", out) == 0
    before = {cell.name for cell in (out / "cells").iterdir()}
    capsys.readouterr()
    larger = ["sweep", "--particles", "1,2,3", "--out", out]
    assert call(*larger, "--plan") == 0
    assert "1 job (2 of 3 are done)" in capsys.readouterr().out
    assert call(*larger, "--no-worst") == 0
    rows = {row["particles"]: row for row in pq.read_table(out / "sweep.parquet").to_pylist()}
    assert {row["key"] for row in rows.values()} > before
    assert [rows[count]["refined"] for count in (1, 2, 3)] == [True, True, True]
    # a setting that says so is another question
    assert call(*larger, "--refine", "none", "--plan") == 2


@pytest.mark.usefixtures("in_this_process")
def test_a_directory_alone_says_which_sweep_gets_more_seeds(copied):
    assert call("sweep", "--out", copied, "--seeds", "3", "--no-worst") == 0
    rows = pq.read_table(copied / "sweep.parquet").to_pylist()
    assert len(rows) == 12
    assert {row["line"] for row in rows} == {"improved", "motion"}


def test_flags_that_are_left_out_are_as_in_the_directory(world, copied):
    request = SweepOptions(worlds=f"{world},apartment")
    spec = request.specification(None, copied)
    assert spec.particles == (1, 3)
    assert len(spec.seeds) == 2
    assert spec.worlds[1] == "apartment"


def test_another_margin_is_another_question_to_the_same_runs(copied):
    before = {cell.name: (cell / "timing.json").read_bytes() for cell in (copied / "cells").iterdir()}
    assert call("sweep", "--out", copied, "--margin", "2mm", "--no-worst") == 0
    assert {cell.name: (cell / "timing.json").read_bytes() for cell in (copied / "cells").iterdir()} == before
    table = markdown_table(summarise(read_sweep(copied)))
    assert "at most 2 mm (room " in table
    assert "Each seed drives another route" in table
    assert "Robot create3, lidar" in table


@pytest.mark.parametrize("fewer", [{"seeds": "1"}, {"particles": "1"}, {"set": "refine=true"}])
def test_less_or_other_settings_are_another_sweep(world, copied, capsys, fewer):
    before = (copied / "sweep.toml").read_bytes()
    assert_refused(capsys, "holds another sweep", *changed_grid(world, **fewer), "--out", copied)
    assert (copied / "sweep.toml").read_bytes() == before


def test_jobs_of_later_looks_are_not_called_unneeded(world, tmp_path):
    out = tmp_path / "sweep"
    request = SweepOptions(worlds=str(world), particles="2,3", seeds="24", until="decided")
    directory, _ = prepare(out, request.specification(None, None))
    assert call("gather", out, "--no-worst") == 1
    states = {row["seed"]: row["status"] for row in pq.read_table(out / "sweep.parquet").to_pylist()}
    first = directory.manifest.spec.looks[0]
    assert {state for seed, state in states.items() if seed < first} == {"missing"}
    assert {state for seed, state in states.items() if seed >= first} == {"later"}
