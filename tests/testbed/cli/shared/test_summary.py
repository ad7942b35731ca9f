# SPDX-License-Identifier: MIT
"""What the terminal says at the end of a run."""

from __future__ import annotations

import io
import json
import shlex
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from eval.files.failure_json import read_failure
from eval.files.run_reader import read_run
from eval.files.tum import read_tum
from eval.report.verdict import verdict
from testbed.cli.shared.summary import headline_table, watch_command
from tests.eval.synthetic_run import write_run


def printed(metrics: dict[str, object], run: Path | None = None) -> str:
    out = io.StringIO()
    Console(file=out, width=200).print(headline_table(metrics, run))
    return out.getvalue()


def test_walls_are_summed_up_without_the_iou_of_single_cells() -> None:
    walls = {
        "iou": 0.431,
        "walls_within_cell_rate": 0.96,
        "missing_wall_rate": 0.007,
        "double_wall_rate": 0.037,
        "wall_thickness_m": 0.056,
        "true_wall_thickness_m": 0.053,
        "wall_distance_subcell_m": 0.0041,
    }
    text = printed({"outcome": "ok", "outcome_reason": "every loop closes", "map": walls})
    for figure in ("96.0%", "0.7%", "3.7%", "0.056 m (0.053 m)", "0.0041 m"):
        assert figure in text
    assert "0.431" not in text
    assert "every loop closes" not in text  # nothing to explain


def test_the_reason_stands_beside_every_outcome_that_is_not_ok() -> None:
    for outcome in ("lost", "broken loop", "drift", "collided", "timeout", "interrupted", "unjudged"):
        assert "because" in printed({"outcome": outcome, "outcome_reason": "because"})
    assert "no scan" in printed({"outcome": "failed", "reason": "no scan"})


def test_each_trajectory_error_names_its_path() -> None:
    def lines(**metrics: object) -> list[list[str]]:
        text = printed({"outcome": "ok", **metrics})
        return [line.split("  ") for line in text.splitlines() if "ATE" in line]

    final, own, online = ({"ate_rmse_m": error} for error in (0.004, 0.017, 0.026))
    refined = lines(refined=True, trajectory=final, trajectory_filter=own, trajectory_online=online)
    assert [(line[0], line[-1].strip()) for line in refined] == [
        ("trajectory error (ATE), after the final pass", "0.004 m"),
        ("trajectory error (ATE), the filter's own path", "0.017 m"),
        ("trajectory error (ATE), while driving", "0.026 m"),
    ]
    plain = lines(refined=False, trajectory=own, trajectory_filter=own, trajectory_online=online)
    assert [line[0].split(", ")[1] for line in plain] == ["the filter's own path", "while driving"]
    assert [line[0] for line in lines(trajectory=own)] == ["trajectory error (ATE)"]


def test_the_self_check_is_said_with_time_and_reason() -> None:
    check = {"verdict": "lost", "reason": "walls cross", "stamp": 5e8, "time_s": 12.0, "place": [1.0, 2.0, 0.0]}
    text = printed({"outcome": "unjudged", "self_check": check})
    assert (
        "self-check, without truth  lost; the first sign that stays is at 12.0 s, at (1.0, 2.0) m of the map's "
        "frame: walls cross" in text
    )
    assert "self-check" not in printed({"outcome": "ok"})


@pytest.mark.parametrize(("word", "first"), [("plausible", None), ("lost", 40.0)])
def test_the_self_check_while_driving_is_said_as_in_the_report(tmp_path: Path, word: str, first: float | None) -> None:
    """Doubtful from 26 s on, lost from 41 s on: the terminal says both, in the words of the report."""
    run = write_run(tmp_path / "run")
    table = pq.read_table(run / "steps.parquet").to_pydict()
    verdicts = np.zeros(len(table["stamp"]))
    verdicts[260:410], verdicts[410:] = 1.0, 2.0 if word == "lost" else 1.0
    pq.write_table(pa.table(table | {"self_check": verdicts}), run / "steps.parquet")
    stamp = None if first is None else 1000.0 + first
    check = {"verdict": word, "reason": "because", "stamp": stamp, "time_s": first, "place": None}
    metrics = json.loads((run / "metrics.json").read_text()) | {"self_check": check}
    (run / "metrics.json").write_text(json.dumps(metrics))
    row = next(line for line in printed(metrics, run).splitlines() if line.startswith("self-check"))
    said = row.removeprefix("self-check, without truth").strip()
    story = verdict(read_run(run)).sentences[0]
    if word == "plausible":
        assert said == "plausible: because. While driving it was doubtful from 26.0 s on"
        assert story == f"The run's own check, without any truth: {said}."
        return
    sure, before = (
        "while driving the check said lost from 41.0 s on",
        "Before that, while driving, it was doubtful from",
    )
    assert said.startswith(f"lost; the first sign that stays is at 40.0 s; {sure}: because. {before} 26.0 s on")
    assert sure in story
    assert before in story


def test_the_moment_and_the_cause_of_a_loss_are_named(tmp_path: Path) -> None:
    run = write_run(tmp_path / "a run", broken=True)
    metrics = json.loads((run / "metrics.json").read_text())
    finding = json.loads((run / "finding.json").read_text())
    (run / "finding.json").write_text(json.dumps(finding | {"cause": "the wheels slipped: by 12 degrees"}))
    seconds = read_failure(run / "finding.json").failure.stamp - read_tum(run / "estimate.tum").stamps[0]
    row = next(line for line in printed(metrics, run).splitlines() if line.startswith("went wrong"))
    words = row.split()
    assert words[2] == "from"
    assert float(words[3]) == pytest.approx(seconds, abs=0.11)
    assert row.rstrip().endswith(" s on: the wheels slipped")
    assert "went wrong" not in printed(metrics | {"outcome": "ok"}, run)
    assert "went wrong" not in printed(metrics)


def test_a_loss_is_said_with_the_bent_map_before_it(tmp_path: Path) -> None:
    run = write_run(tmp_path / "a run", broken=True)
    metrics = json.loads((run / "metrics.json").read_text())
    assert "the map was bent" not in printed(metrics, run)
    table = pq.read_table(run / "steps.parquet").to_pydict()
    stamps = np.array(table["stamp"])
    bent = (stamps - stamps[0] > 20.0) & (stamps - stamps[0] < 40.0)
    x = np.array(table["x"]) + 0.45 * bent
    pq.write_table(pa.table(table | {"x": x, "error_m": np.where(bent, 0.45, 0.0)}), run / "steps.parquet")
    row = next(line for line in printed(metrics, run).splitlines() if line.startswith("behind it"))
    assert "the map was bent: the pose while driving had drifted from " in row
    assert "by up to 45\N{NO-BREAK SPACE}cm" in row


def test_a_loss_is_to_be_watched_where_it_was_recorded(tmp_path: Path) -> None:
    run = write_run(tmp_path / "a run", broken=True)
    metrics = json.loads((run / "metrics.json").read_text())
    assert watch_command(metrics, run) is None
    (run / "recording.rrd").touch()
    command = watch_command(metrics, run)
    assert command is not None
    assert command.startswith("watch where it went wrong: ")
    program, view, path, option, time = shlex.split(command.split(": ", 1)[1])
    assert (program, view, Path(path), option) == ("testbed", "view", run, "--time")
    failure = read_failure(run / "finding.json").failure
    assert float(time) == failure.time_to_watch(read_tum(run / "estimate.tum").stamps)
    assert watch_command(metrics | {"outcome": "ok"}, run) is None  # nor has it closed a loop


def with_a_loop(run: Path) -> Path:
    """A run whose largest loop, 57 m, closes from 30 s to 34 s; 11 of 30 particles die at 32 s, 2 at 33 s."""
    table = pq.read_table(run / "steps.parquet").to_pydict()
    lengths, died = np.full(len(table["stamp"]), np.nan), np.zeros(len(table["stamp"]), int)
    lengths[[300, 340]], died[[320, 330]] = (49.0, 57.0), (11, 2)
    pq.write_table(pa.table(table | {"loop_length": lengths, "particles_died": died}), run / "steps.parquet")
    (run / "recording.rrd").touch()
    return run


def test_the_largest_loop_of_a_good_run_is_to_be_watched(tmp_path: Path) -> None:
    run = with_a_loop(write_run(tmp_path / "good"))
    metrics = json.loads((run / "metrics.json").read_text())
    assert metrics["outcome"] == "ok"
    row = next(line for line in printed(metrics, run).splitlines() if line.startswith("largest loop"))
    assert row.removeprefix("largest loop").strip() == (
        "at 32.0 s: 57 m of driving; 11 of 30 particles died (13 in all 2 resamplings of the loop)"
    )
    assert watch_command(metrics, run) == f"watch the largest loop, as particles die: testbed view {run} --time 32.0"
    (run / "recording.rrd").unlink()
    assert watch_command(metrics, run) is None
    lost = with_a_loop(write_run(tmp_path / "lost", broken=True))
    command = watch_command(json.loads((lost / "metrics.json").read_text()), lost)
    assert command is not None
    assert command.startswith("watch where it went wrong")
