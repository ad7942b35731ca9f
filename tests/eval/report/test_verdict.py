# SPDX-License-Identifier: MIT
"""What a report says of a run in words."""

from __future__ import annotations

import json

import pytest

from eval.files.run_reader import read_run
from eval.report.verdict import verdict
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


def test_the_largest_loop_closure_is_said_with_its_time(tmp_path):
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    start = read_run(run).estimate.stamps[0]
    metrics.setdefault("filter", {}).update(loop_closures=1, largest_loop_m=63.7, largest_loop_stamp=start + 129.72)
    (run / "metrics.json").write_text(json.dumps(metrics))
    loop = verdict(read_run(run)).loop
    assert loop.sentence == "The largest loop closure: 129.7 s, after 64 m of driving."
    assert loop.time == pytest.approx(129.72)


def test_a_run_without_a_loop_says_so(tmp_path):
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    metrics.setdefault("filter", {}).update(loop_closures=0, largest_loop_m=None, largest_loop_stamp=None)
    (run / "metrics.json").write_text(json.dumps(metrics))
    loop = verdict(read_run(run)).loop
    assert loop.sentence.startswith("No loop closure was seen while driving: ")
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
    ("word", "severity", "lead"),
    [
        ("plausible", "none", "finds it plausible"),
        ("doubtful", "fair", "has doubts"),
        ("lost", "bad", "lost the robot"),
    ],
)
def test_an_unjudged_run_is_led_by_its_own_check(tmp_path, word, severity, lead):
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    check = {"verdict": word, "reason": "because", "stamp": 112.5, "time_s": 12.5, "place": [1.0, -2.0, 0.0]}
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "unjudged", "self_check": check}))
    found = verdict(read_run(run))
    assert lead in found.lead
    assert found.severity == severity
    expected = (
        f"The run's own check, without any truth: {word} from 12.5 s on at (1.0, -2.0) m of the map's frame: because."
    )
    assert found.sentences[0] == expected


def test_the_truth_leads_where_it_is_known(tmp_path):
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    check = {"verdict": "lost", "reason": "because", "stamp": None, "time_s": None, "place": None}
    (run / "metrics.json").write_text(json.dumps(metrics | {"outcome": "ok", "self_check": check}))
    found = verdict(read_run(run))
    assert found.lead.startswith("OK: ")
    assert found.sentences[0] == "The run's own check, without any truth: lost: because."
