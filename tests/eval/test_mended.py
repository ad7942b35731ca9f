# SPDX-License-Identifier: MIT
"""What the final pass has mended has a moment, a reason and a cause, as what it has not."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from eval.files.run_reader import read_run
from eval.files.tum import read_tum
from eval.mended import find_mended
from eval.report.run_report import write_report
from eval.report.verdict import verdict
from tests.eval.synthetic_run import BREAK, write_run


def mended_run(folder: Path, outcome: str) -> Path:
    """A good run whose pose while driving turns by 12 degrees at the scan `BREAK`."""
    run, wrong = write_run(folder / "run"), write_run(folder / "wrong", broken=True)
    shutil.copy(wrong / "estimate.tum", run / "online.tum")
    metrics = json.loads((run / "metrics.json").read_text())
    assert metrics["outcome"] == "ok"
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome_online": outcome, "outcome_filter": "ok"}))
    return run


def test_the_moment_is_that_of_the_pose_while_driving(tmp_path: Path) -> None:
    run = mended_run(tmp_path, "broken loop")
    metrics = json.loads((run / "metrics.json").read_text())
    found = find_mended(metrics, run)
    assert found is not None
    broken_at = 1000.0 + 0.1 * BREAK
    assert broken_at <= found.stamp <= broken_at + 2.0
    assert (found.outcome, found.which) == ("broken loop", "while driving")
    assert found.time_to_watch == pytest.approx(found.stamp - 1000.0, abs=0.1)  # what is named is what is shown
    assert found.errors is not None
    judged = verdict(read_run(run))
    assert "That is the final path: while driving the outcome was broken loop" in judged.lead
    moment = f"The moment shown below is {found.time_to_watch:.1f} s: "
    assert moment in " ".join(judged.sentences)
    page = write_report(run).read_text()
    assert "<h2>What the final pass mended</h2>" in page
    assert f"--time {found.time_to_watch:.1f}</code>" in page
    assert find_mended(metrics | {"outcome_online": "ok"}, run) is None
    assert find_mended(metrics | {"outcome": "lost"}, run) is None  # nothing was mended


def test_the_report_draws_the_moment_and_the_update_before_it(tmp_path: Path) -> None:
    run = mended_run(tmp_path, "broken loop")
    found = find_mended(json.loads((run / "metrics.json").read_text()), run)
    assert found is not None
    table = pq.read_table(run / "steps.parquet").to_pydict()
    updates = np.array(table["stamp"])[np.array(table["updated"], bool)] - 1000.0

    class Drawn:
        another_best = np.zeros(0)
        times: ClassVar[list[float]] = []

        def png(self, time: float) -> bytes:
            self.times.append(time)
            return b"picture"

    page = write_report(run, Drawn()).read_text()
    before = max(updates[updates < found.stamp - 1000.0 - 1e-6])
    for time, name in ((before, "At the update before it"), (found.time_to_watch, "Where it went wrong while driving")):
        assert any(drawn == pytest.approx(time, abs=0.1) for drawn in Drawn.times)
        assert name in page


def test_another_best_particle_at_the_moment_is_its_cause(tmp_path: Path) -> None:
    run = mended_run(tmp_path, "broken loop")
    metrics = json.loads((run / "metrics.json").read_text())
    found = find_mended(metrics, run)
    assert found is not None
    table = pq.read_table(run / "steps.parquet").to_pydict()
    moved = np.zeros(len(table["stamp"]))
    at = int(np.argmin(np.abs(np.array(table["stamp"]) - found.stamp)))
    for row, expected in ((at, True), (at + 5, False)):  # another update says nothing of this one
        moved[:] = 0.0
        moved[row] = 0.23
        pq.write_table(pa.table(table | {"best_moved_m": moved}), run / "steps.parquet")
        again = find_mended(metrics, run)
        assert again is not None
        assert again.stamp == found.stamp
        words = "another particle became the best: the reported pose moved by 23\N{NO-BREAK SPACE}cm"
        assert (again.cause == words) is expected


def test_without_a_moment_it_is_the_longest_drift(tmp_path: Path) -> None:
    """From 30 s to 60 s the pose while driving is 0.4 m off, and for a second at 80 s."""
    run = mended_run(tmp_path, "drift")
    shutil.copy(run / "estimate.tum", run / "online.tum")
    estimate = read_tum(run / "estimate.tum")
    table = pq.read_table(run / "steps.parquet").to_pydict()
    off = np.zeros(len(estimate))
    off[300:600], off[800:830] = 0.4, 0.4
    true = np.column_stack([table[f"true_{name}"] for name in ("x", "y", "theta")])
    table |= {"x": true[:, 0], "y": true[:, 1] + off, "theta": true[:, 2], "error_m": off}
    pq.write_table(pa.table(table), run / "steps.parquet")
    found = find_mended(json.loads((run / "metrics.json").read_text()), run)
    assert found is not None
    assert found.stamp == pytest.approx(1030.0, abs=0.6)
    assert found.reason == "the pose while driving drifts for 30 s, by up to 0.40 m"
    assert found.cause is None
    assert found.course is not None
    assert len(found.course.spells) == 2
    words = found.course.in_words(1000.0)
    assert words.startswith("the pose was first off the truth at 30.")
    assert words.endswith("s (40\N{NO-BREAK SPACE}cm), and back for good at 83.0 s")


def test_a_moment_at_which_the_error_falls_is_no_way_off(tmp_path: Path) -> None:
    """The pose while driving is 0.5 m off from 20 s on, and at the moment of the jump comes nearer to the truth."""
    run = mended_run(tmp_path, "broken loop")
    table = pq.read_table(run / "steps.parquet").to_pydict()
    off = np.zeros(len(table["stamp"]))
    off[200:BREAK], off[BREAK : BREAK + 200] = 0.5, 0.3
    true = np.column_stack([table[f"true_{name}"] for name in ("x", "y", "theta")])
    table |= {"x": true[:, 0], "y": true[:, 1] + off, "theta": true[:, 2], "error_m": off}
    pq.write_table(pa.table(table), run / "steps.parquet")
    found = find_mended(json.loads((run / "metrics.json").read_text()), run)
    assert found is not None
    assert found.stamp == pytest.approx(1020.0, abs=0.6)  # where the drift begins, not where it is left
    assert found.reason.startswith("the pose while driving drifts for ")
    assert found.errors is not None
    assert found.errors[0] <= found.errors[1]
