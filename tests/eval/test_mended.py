# SPDX-License-Identifier: MIT
"""What the final pass has mended has a moment, a reason and a cause, as what it has not."""

from __future__ import annotations

import base64
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from eval.files.run_reader import read_run
from eval.files.tum import read_tum
from eval.first_failure import find_failure
from eval.mended import find_mended
from eval.report.run_report import write_report
from eval.report.verdict import verdict
from testbed.cli.shared.summary import headline_table
from tests.eval.synthetic_run import BREAK, write_run


def mended_run(folder: Path, outcome: str) -> Path:
    """A good run whose pose while driving turns by 12 degrees at the scan `BREAK`."""
    run, wrong = write_run(folder / "run"), write_run(folder / "wrong", broken=True)
    shutil.copy(wrong / "estimate.tum", run / "online.tum")
    shutil.copy(wrong / "steps.parquet", run / "steps.parquet")
    metrics = json.loads((run / "metrics.json").read_text())
    assert metrics["outcome"] == "ok"
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome_online": outcome, "outcome_filter": "ok"}))
    return run


@pytest.mark.usefixtures("without_pictures")
def test_the_moment_is_that_of_the_pose_while_driving(tmp_path: Path) -> None:
    run = mended_run(tmp_path, "broken loop")
    metrics = json.loads((run / "metrics.json").read_text())
    found = find_mended(metrics, run)
    assert found is not None
    broken_at = 1000.0 + 0.1 * BREAK
    assert broken_at <= found.stamp <= broken_at + 2.0
    assert (found.outcome, found.which) == ("broken loop", "while driving")
    assert found.time_to_watch == pytest.approx(found.stamp - 1000.0, abs=0.1)  # what is named is what is shown
    assert found.driving is not None
    judged = verdict(read_run(run))
    assert judged.lead.startswith("The final path is OK: trajectory error ")
    assert "While driving it was not: broken loop, most of all from " in judged.lead
    assert f"While driving it went wrong at {found.time_to_watch:.1f} s: " in " ".join(judged.sentences)
    page = write_report(run).read_text()
    assert "<h2>Where it went wrong while driving, before the final pass mended it</h2>" in page
    assert page.index("<summary>The worst metre of the path: no failure") > page.index(found.driving.evidence)
    assert f"--time {found.time_to_watch:.1f}</code>" in page
    assert find_mended(metrics | {"outcome_online": "ok"}, run) is None
    assert find_mended(metrics | {"outcome": "lost"}, run) is None  # nothing was mended


@pytest.mark.usefixtures("without_pictures")
def test_the_report_draws_the_moment_and_the_update_before_it(tmp_path: Path) -> None:
    run = mended_run(tmp_path, "broken loop")
    found = find_mended(json.loads((run / "metrics.json").read_text()), run)
    assert found is not None
    table = pq.read_table(run / "steps.parquet").to_pydict()
    updates = np.array(table["stamp"])[np.array(table["updated"], bool)] - 1000.0

    class Drawn:
        another_best = np.zeros(0)
        times: ClassVar[list[float]] = []
        pairs: ClassVar[list[tuple[float, float]]] = []

        def png(self, time: float, compared_with: Sequence[float] = ()) -> bytes:
            self.times.append(time)
            return b"picture"

        def side_by_side(self, before: float, at: float) -> bytes:
            self.pairs.append((before, at))
            return b"pair"

        def map_at(self, time: float) -> None:
            return None

    page = write_report(run, Drawn()).read_text()
    assert page.count(base64.b64encode(b"pair").decode()) == 1
    before = max(updates[updates < found.stamp - 1000.0 - 1e-6])
    assert found.driving is not None
    assert Drawn.pairs == [pytest.approx((before, found.time_to_watch), abs=0.1)]
    worst = found.driving.worst.worst - 1000.0
    named = (found.time_to_watch, "Where it went wrong while driving, "), (worst, "The largest error of the pose while")
    for time, name in named:
        assert any(drawn == pytest.approx(time, abs=0.1) for drawn in Drawn.times)
        assert name in page


def test_the_terminal_ranks_the_times_by_what_they_did(tmp_path: Path) -> None:
    run = mended_run(tmp_path, "broken loop")
    metrics = json.loads((run / "metrics.json").read_text())
    found = find_mended(metrics, run)
    assert found is not None
    assert found.driving is not None
    table = headline_table(metrics, run)
    rows = dict(zip(*(list(column.cells) for column in table.columns), strict=True))
    assert rows["outcome"] == "ok (the final path)"
    assert rows["while driving"] == f"broken loop, mended by the final pass: {found.driving.evidence}"
    assert rows["went wrong while driving"].startswith(f"at {found.time_to_watch:.1f} s: ")
    assert "outcome while driving" not in rows


def test_the_terminal_says_the_order_of_several_other_times(tmp_path: Path) -> None:
    """The pose is off from 10 s to 12 s, from 20 s to 23 s, and after the break; only the last tears the map."""
    run = mended_run(tmp_path, "broken loop")
    table = pq.read_table(run / "steps.parquet").to_pydict()
    seconds = np.array(table["stamp"]) - 1000.0
    off = 0.5 * ((seconds > 10.0) & (seconds < 12.0)) + 0.7 * ((seconds > 20.0) & (seconds < 23.0))
    moved = {"x": np.array(table["x"]) + off, "error_m": np.where(off > 0.0, off, table["error_m"])}
    pq.write_table(pa.table(table | moved), run / "steps.parquet")
    printed = headline_table(json.loads((run / "metrics.json").read_text()), run)
    rows = list(zip(*(list(column.cells) for column in printed.columns), strict=True))
    at = next(number for number, row in enumerate(rows) if row[0].startswith("also off the truth"))
    assert rows[at][0] == "also off the truth, most harm first"
    assert rows[at][1].startswith("from 20.")
    assert rows[at][1].endswith("; none of the pairs that do not meet")
    assert rows[at + 1][0] == ""
    assert rows[at + 1][1].startswith("from 10.")
    assert not any("this time" in row[1] or "these pairs" in row[1] for row in rows)


def test_without_the_steps_it_is_the_failure_of_the_path(tmp_path: Path) -> None:
    run = mended_run(tmp_path, "lost")
    (run / "steps.parquet").unlink()
    metrics = json.loads((run / "metrics.json").read_text())
    found = find_mended(metrics, run)
    failure = find_failure(read_tum(run / "online.tum"), truth=read_tum(run / "truth.tum"))
    assert found is not None
    assert failure is not None
    assert failure.bad
    assert (found.stamp, found.driving) == (failure.stamp, None)
    assert found.cause.startswith(failure.reason)
