# SPDX-License-Identifier: MIT
"""Lines and states say when the estimate is lost and found again, and when scans fit poorly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from slam.diagnosis.contradiction import SelfCheck
from slam.step.step_report import StepReport
from testbed.views import Snapshot
from testbed.views.rerun import entities
from testbed.views.rerun.layers.events import EventWatch, Line, StateChange
from tests.testbed.views.synthetic import snapshots


def watched(
    estimates: np.ndarray, shares: list[float] | None = None, changed: dict[int, dict[str, Any]] | None = None
) -> tuple[list[Line], list[StateChange]]:
    """All lines and states of a drive along the x axis, 5 cm from one update to the next; changed: other fields of the
    step of some updates."""
    last = [s for s in snapshots(2.0, particles=2) if s.step is not None and s.step.proposed is not None][-1]
    assert isinstance(last.step, StepReport)
    watch, lines, states = EventWatch(), [], []
    for k, estimate in enumerate(estimates):
        step = replace(last.step, updated=True, resampled=False, matched_share=1.0 if shares is None else shares[k])
        step = replace(step, **(changed or {}).get(k, {}))
        truth = np.array([0.05 * k, 0.0, 0.0])
        snapshot: Snapshot = replace(last, step=step, truth=truth, estimate=estimate)
        more, changes = watch.update(snapshot, (0.1 * k, k), 0)
        lines += more
        states += changes
    return lines, states


def along(count: int) -> np.ndarray:
    return np.column_stack([0.05 * np.arange(count), np.zeros(count), np.zeros(count)])


def test_a_loss_and_its_end_are_said_at_the_time_when_they_happened() -> None:
    poses = along(300)
    poses[100:200, 1] += 0.9
    lines, states = watched(poses)
    assert [(line.level, line.text.split(":")[0], line.at) for line in lines] == [
        ("ERROR", "lost", (10.0, 100)),
        ("INFO", "found again", (20.0, 200)),
    ]
    assert (
        lines[0].text
        == "lost: the motion over the last metre is wrong by 0.90 m and 0° now, by 0.90 m and 0° 0.2 m later"
    )
    lane = [(change.state, change.at) for change in states if change.lane == entities.ESTIMATE_STATE]
    assert lane == [
        ("close to the truth (limit 35 cm)", None),
        ("lost", (10.0, 100)),
        ("close to the truth (limit 35 cm)", (20.0, 200)),
    ]


def test_a_loss_says_how_wrong_the_motion_is_at_its_time_and_when_that_is_known() -> None:
    """The estimate is off by 0.6 m at first, and by 5 cm more at each update."""
    poses = along(300)
    poses[100:, 1] += 0.6 + 0.05 * np.arange(200)
    lines, _ = watched(poses)
    assert lines[0].at == (10.0, 100)
    assert "wrong by 0.60 m and 0° now, by 0.80 m and 0° 0.2 m later" in lines[0].text


def test_an_estimate_that_drifts_is_a_state_and_no_line() -> None:
    poses = along(300)
    poses[:, 1] += np.linspace(0.0, 1.0, 300)
    lines, states = watched(poses)
    assert lines == []
    assert [change.state for change in states if change.lane == entities.ESTIMATE_STATE][1:] == ["has drifted"]


def test_scans_that_fit_poorly_are_said_with_their_share() -> None:
    shares = [1.0] * 60 + [0.7] + [1.0] * 20 + [0.7] * 10 + [1.0] * 9
    lines, states = watched(along(100), shares)
    assert [(line.level, line.text) for line in lines] == [
        ("WARN", "the scans fit the map poorly: 70% of the hits meet its walls (usual: 100%)")
    ]
    lane = [change.state for change in states if change.lane == entities.MATCHING_STATE]
    assert lane == ["scan fits the map", "scan fits poorly", "scan fits the map"]


def test_wheels_that_slip_again_and_again_are_said_once_a_minute() -> None:
    jumps = {k: {"odometry_jumped": True} for k in (20, 21, 150, 500, 700)}
    lines, _ = watched(along(800), changed=jumps)
    text = "the odometry moved further between two scans than a robot drives: left out"
    assert [(line.level, line.text) for line in lines] == [("WARN", text), ("WARN", f"{text} (3 more since 2 s)")]


def test_the_self_check_is_a_lane_and_each_loss_a_line() -> None:
    verdicts = ["plausible"] * 10 + ["doubtful"] * 10 + ["lost"] * 10 + ["doubtful"] * 10 + ["lost"] * 10
    changed = {k: {"self_check": SelfCheck(verdict, "walls cross")} for k, verdict in enumerate(verdicts)}  # type: ignore[arg-type]
    lines, states = watched(along(50), changed=changed)
    assert [(line.level, line.text) for line in lines] == [("WARN", "the self-check says lost: walls cross")] * 2
    lane = [change.state for change in states if change.lane == entities.SELF_CHECK_STATE]
    assert lane == ["plausible", "doubtful", "says lost", "doubtful", "says lost"]
