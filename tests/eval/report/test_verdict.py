# SPDX-License-Identifier: MIT
"""What a report says of a run in words."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from eval.failure_cause import RECOVERED
from eval.files.run_reader import read_run
from eval.loss_watch import spells
from eval.report.report_context import ReportContext
from eval.report.run_report import write_report
from eval.report.verdict import _loop, verdict
from eval.wording import at_time
from tests.eval.synthetic_run import write_run


def test_the_verdict_of_a_good_run_names_both_errors(tmp_path):
    found = verdict(read_run(write_run(tmp_path / "good")))
    assert found.severity == "good"
    assert "wheel odometry alone has" in " ".join(found.sentences)
    assert [headline.label for headline in found.headlines][:2] == ["trajectory error", "heading error"]
    assert found.lead.startswith("OK: trajectory error ")


@pytest.mark.parametrize(("exact", "shown"), [(None, "2.7\u00a0cm"), (0.0153, "1.5\u00a0cm")])
def test_the_wall_distance_is_that_of_the_summary(tmp_path, exact, shown):
    """It is measured against the exact walls where they are known, else against the cells of the true map."""
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    metrics["map"] |= {"wall_distance_m": 0.027, "coverage": 0.99, "wall_distance_subcell_m": exact}
    (run / "metrics.json").write_text(json.dumps(metrics))
    found = verdict(read_run(run))
    assert f"true walls is {shown}" in " ".join(found.sentences)
    assert shown in [headline.value for headline in found.headlines]


def with_steps(run, **columns):
    """The run with other columns in its table of steps, arrays (scans,)."""
    table = pq.read_table(run / "steps.parquet")
    for name, values in columns.items():
        if name in table.column_names:
            table = table.drop_columns([name])
        table = table.append_column(name, pa.array(values))
    pq.write_table(table, run / "steps.parquet")
    return read_run(run)


def test_the_largest_loop_is_said_with_what_the_particles_did(tmp_path):
    run = write_run(tmp_path / "run")
    n = len(read_run(run).steps["scan"])
    lengths, died, spread = np.zeros(n), np.zeros(n, np.int64), np.full(n, 0.05)
    lengths[300], lengths[350], lengths[50] = 20.0, 63.7, 30.0
    died[[320, 400]], died[100] = (11, 2), 20
    spread[390:420], spread[[120, 410]] = 0.02, (0.001, 0.016)
    loop = verdict(with_steps(run, loop_length=lengths, particles_died=died, spread_m=spread)).loop
    assert loop.sentence.startswith(
        "The largest loop, at 32.0 s: 64 m of driving. Then 11 of 30 particles died (13 in all 2 resamplings of the "
        "loop), and their spread went from 5.0\u00a0cm at 30.0 s, when old walls came into view, to 1.6\u00a0cm at "
        "41.0 s."
    )
    assert "35.0 s" not in loop.sentence  # where it has its full length, at which nothing happens
    assert loop.time == pytest.approx(32.0)


def test_a_jump_to_another_particle_in_a_loop_is_said(tmp_path):
    run = write_run(tmp_path / "run")
    n = len(read_run(run).steps["scan"])
    lengths, moved, error = np.zeros(n), np.zeros(n), np.full(n, 0.26)
    lengths[300], moved[305], error[305:] = 40.0, 0.28, 0.5
    columns = {"loop_length": lengths, "particles_died": np.zeros(n, np.int64), "spread_m": np.linspace(0.9, 0.1, n)}
    said = verdict(with_steps(run, **columns, best_moved_m=moved, error_m=error)).loop.sentence
    assert (
        "was 26\u00a0cm before old walls came into view, went from 26\u00a0cm to 50\u00a0cm then, as another particle "
        "became the best, and was 50\u00a0cm at " in said
    )
    assert "Then no particle died, and another became the best: the" in said
    assert "their spread, in which each counts by its weight, went from" in said


def test_what_the_headline_tells_is_not_told_again(tmp_path):
    """The jump at 30.5 s is the moment that the report has described before."""
    run = write_run(tmp_path / "run")
    n = len(read_run(run).steps["scan"])
    lengths, moved, error = np.zeros(n), np.zeros(n), np.full(n, 0.26)
    lengths[300], moved[305], error[305:] = 40.0, 0.28, 0.5
    columns = {"loop_length": lengths, "particles_died": np.zeros(n, np.int64), "spread_m": np.linspace(0.9, 0.1, n)}
    files = with_steps(run, **columns, best_moved_m=moved, error_m=error)
    said = _loop(ReportContext.of(files), told=files.steps["stamp"][305]).sentence
    assert "another became the best, and their spread" in said
    assert "was 26\u00a0cm before old walls came into view and was 50\u00a0cm at 4" in said


def test_the_errors_in_a_loop_are_said_in_the_order_of_time(tmp_path):
    """Old walls come into view at 30 s, another particle becomes the best at 32 s, full length at 34 s."""
    run = write_run(tmp_path / "run")
    n = len(read_run(run).steps["scan"])
    lengths, moved, error = np.zeros(n), np.zeros(n), np.full(n, 0.11)
    lengths[300], lengths[340], moved[320] = 20.0, 60.0, 0.2
    error[300:], error[320:], error[340:] = 0.22, 0.33, 0.44
    columns = {"loop_length": lengths, "particles_died": np.zeros(n, np.int64), "spread_m": np.linspace(0.9, 0.1, n)}
    said = verdict(with_steps(run, **columns, best_moved_m=moved, error_m=error)).loop.sentence
    assert (
        "was 11\u00a0cm before old walls came into view, went from 22\u00a0cm to 33\u00a0cm then, as another "
        "particle became the best, and was 44\u00a0cm at 4"
    ) in said


def test_a_run_without_a_loop_says_so(tmp_path):
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    metrics.setdefault("filter", {}).update(loop_closures=0, largest_loop_m=None, largest_loop_stamp=None)
    (run / "metrics.json").write_text(json.dumps(metrics))
    loop = verdict(read_run(run)).loop
    assert loop.sentence.startswith("No loop was seen while driving: ")
    assert loop.time is None


def loop(stamp, seen_before, *, accepted=True, closed=True, gap=0.02):
    """An entry of the list of loops in `metrics.json`."""
    return {
        "stamp": stamp,
        "seen_before_stamp": seen_before,
        "length_m": 40.0,
        "accepted": accepted,
        "closed_by_filter": closed,
        "gap_m": gap,
        "gap_deg": 0.5,
        "overlap_m": 12.0,
        "agreeing_share": 0.95,
    }


def with_loops(run, loops):
    """The run with these loops found by its final pass."""
    metrics = json.loads((run / "metrics.json").read_text())
    accepted = [row for row in loops if row["accepted"]]
    metrics["loops"] = {
        "found": len(loops),
        "accepted": len(accepted),
        "rejected": len(loops) - len(accepted),
        "left_open_by_filter": sum(not row["closed_by_filter"] for row in accepted),
        "path_changed": any(not row["closed_by_filter"] for row in accepted),
        "list": loops,
    }
    (run / "metrics.json").write_text(json.dumps(metrics))
    return read_run(run)


@pytest.mark.parametrize(
    ("last", "said"),
    [
        ({}, "found 2 loops, all of which the filter had closed."),
        ({"closed": False, "gap": 0.93}, "had left 1 open: the widest gap, 93\u00a0cm, at 40.0 s, is closed now."),
        ({"accepted": False}, "found 1 loop, which the filter had closed. 1 match was rejected"),
    ],
)
def test_loops_of_the_final_pass_are_said(tmp_path, last, said):
    run = write_run(tmp_path / "run")
    start = float(read_run(run).estimate.stamps[0])
    found = verdict(with_loops(run, [loop(start + 30.0, start + 2.0), loop(start + 40.0, start + 3.0, **last)]))
    assert said in " ".join(found.sentences)


@pytest.mark.parametrize(
    ("word", "severity", "lead", "sign"),
    [
        ("plausible", "none", "finds it plausible", "its first sign"),
        ("doubtful", "fair", "has doubts", "its first sign"),
        ("lost", "bad", "lost the robot", "the first sign that stays"),
    ],
)
def test_an_unjudged_run_is_led_by_its_own_check(tmp_path, word, severity, lead, sign):
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    check = {"verdict": word, "reason": "because", "stamp": 112.5, "time_s": 12.5, "place": [1.0, -2.0, 0.0]}
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "unjudged", "self_check": check}))
    found = verdict(read_run(run))
    assert lead in found.lead
    assert found.severity == severity
    assert found.sentences[0].startswith(f"The run's own check, without any truth: {word}; {sign} is at 12.5 s, ")
    assert found.sentences[0].endswith("m in the plots below. It saw this: because.")


def test_the_truth_leads_where_it_is_known(tmp_path):
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    check = {"verdict": "lost", "reason": "because", "stamp": None, "time_s": None, "place": None}
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "ok", "self_check": check}))
    found = verdict(read_run(run))
    assert found.lead.startswith("OK: ")
    assert found.sentences[0] == "The run's own check, without any truth: lost: because."


def test_the_check_and_the_headline_tell_one_story(tmp_path):
    """The place is in the frame of the plots, and each time at which the filter called itself lost is named."""
    run = write_run(tmp_path / "run", broken=True)
    files = read_run(run)
    start, n = float(files.estimate.stamps[0]), len(files.estimate)
    metrics = json.loads((run / "metrics.json").read_text())
    moment = files.failure.failure.stamp - start
    first = round(moment - 1.5, 1)
    check = {
        "verdict": "lost",
        "reason": "because",
        "stamp": start + first,
        "time_s": first,
        "place": [50.0, 60.0, 0.0],
    }
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "lost", "self_check": check}))
    verdicts = np.zeros(n)
    verdicts[100:150], verdicts[150:], verdicts[round(10 * moment) + 20 :] = 2.0, 1.0, 2.0
    sentence = verdict(with_steps(run, self_check=verdicts)).sentences[0]
    x, y = files.truth.poses[round(10 * first), :2]
    assert f"is at {first:.1f} s, at ({x:.1f}, {y:.1f}) m in the plots below, 1.5 s before the truth shows" in sentence
    assert f"while driving the check said lost from {moment + 2.0:.1f} s" in sentence
    assert sentence.endswith("it said lost from 10.0 s to 15.0 s and was doubtful from 15.0 s on.")


def test_a_first_sign_at_the_loss_is_not_said_to_be_0_s_away(tmp_path):
    run = write_run(tmp_path / "run", broken=True)
    files = read_run(run)
    metrics, moment = json.loads((run / "metrics.json").read_text()), files.failure.failure.stamp
    check = {"verdict": "lost", "reason": "because", "stamp": moment, "place": [50.0, 60.0, 0.0]}
    check["time_s"] = moment - float(files.estimate.stamps[0])
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "lost", "self_check": check}))
    sentence = verdict(read_run(run)).sentences[0]
    assert "when the truth shows a loss too" in sentence
    assert " 0.0 s " not in sentence


def test_a_sign_at_a_right_pose_is_explained_by_the_bent_map(tmp_path):
    """The pose is 45 cm off from 20 s to 25 s, and right at the sign at 40 s; without the drift nothing is said."""
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    check = {"verdict": "lost", "reason": "because", "stamp": 1040.0, "time_s": 40.0, "place": [1.0, 2.0, 0.0]}
    (run / "metrics.json").write_text(json.dumps(metrics | {"self_check": check}))
    n = len(read_run(run).steps["scan"])
    assert "bent" not in verdict(with_steps(run, error_m=np.zeros(n))).sentences[0]
    x, off = np.array(read_run(run).steps["true_x"]), np.zeros(n)
    off[200:250] = 0.45
    found = with_steps(run, x=x + off, y=read_run(run).steps["true_y"], error_m=np.where(off > 0.0, off, 0.041))
    said = verdict(found).sentences[0]
    assert said.endswith(
        " At 40.0 s the pose was only 4.1\u00a0cm off, but it had drifted before: a map that is bent may contradict "
        "the scans also where the pose is right."
    )


def test_a_sign_at_the_return_from_a_loss_is_not_called_late(tmp_path):
    """Lost from 20 s to some time after 25 s, where the pose is right again: the first sign that stays is then."""
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    files = read_run(run)
    x, off = np.array(files.steps["true_x"]), np.zeros(len(files.steps["scan"]))
    off[200:250] = 3.0
    files = with_steps(run, x=x + off, y=files.steps["true_y"], error_m=off)
    (lost,) = spells(files.steps, "lost")
    start = float(files.estimate.stamps[0])
    check = {"verdict": "lost", "reason": "because", "stamp": lost.end, "place": [1.0, 2.0, 0.0]}
    check["time_s"] = lost.end - start
    for late, words in ((0.0, "as the pose comes back from where the truth shows it lost"), (9.0, "s after the truth")):
        check["time_s"] = lost.end - start + late
        (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "lost", "self_check": check}))
        assert words in verdict(read_run(run)).sentences[0]


@pytest.mark.parametrize("bent", [False, True])
def test_slips_that_were_got_over_before_are_no_cause_of_their_own(tmp_path, bent):
    run = write_run(tmp_path / "run", broken=True)
    finding = json.loads((run / "finding.json").read_text())
    cause = f"the wheels slipped: by 12 degrees; they slipped in 3 intervals before this one too, and {RECOVERED}"
    finding |= {"cause": cause, "back": finding["stamp"] + 4.0}
    (run / "finding.json").write_text(json.dumps(finding))
    files = read_run(run)
    moment, start = files.failure.failure.stamp, float(files.estimate.stamps[0])
    if bent:
        stamps, x = np.array(files.steps["stamp"]), np.array(files.steps["x"])
        off = 0.45 * ((stamps - start > 10.0) & (stamps - start < 20.0))
        files = with_steps(run, x=x + off, error_m=off)
    lead = verdict(files).lead
    words = "the map was bent, and the wheels slipped" if bent else "the wheels slipped"
    assert f" It is wrong from {at_time(moment - start)} to {at_time(moment - start + 4.0)}, of" in lead
    assert lead.endswith(f", and comes back: {words}.")
    page = write_report(run).read_text()
    assert f"<strong>Cause:</strong> {words}." in page
    assert f"At {moment - start + 4.0:.1f} s it is back" in page


def test_a_doubt_has_the_time_of_its_first_sign_too(tmp_path):
    """`metrics.json` holds when scans began to contradict, the recording when the verdict changed: both are named."""
    run = write_run(tmp_path / "run")
    files = read_run(run)
    start, n = float(files.estimate.stamps[0]), len(files.estimate)
    metrics = json.loads((run / "metrics.json").read_text())
    verdicts = np.zeros(n)
    verdicts[260:280] = 1.0
    for verdict_of_drive, words in (
        ("doubtful", "it was doubtful from 26.0 s on (the scans that made it so began at 25.1 s)."),
        ("lost", "it was doubtful from 26.0 s on."),
    ):
        driving = {"verdict": verdict_of_drive, "reason": "because", "stamp": start + 25.07, "time_s": 25.07}
        check = {"verdict": "plausible", "reason": "because", "stamp": None, "time_s": None, "while_driving": driving}
        (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "ok", "self_check": check}))
        assert verdict(with_steps(run, self_check=verdicts)).sentences[0].endswith(words)
