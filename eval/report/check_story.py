# SPDX-License-Identifier: MIT
"""What a run says of itself (docs/self-check.md) in the words and the frame of its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.files.run_reader import read_run
from eval.filter.step_table import Columns, column, updates
from eval.loss_watch import Spell, spells
from eval.report.report_context import ReportContext
from eval.wording import at_time, length
from slam.se2 import transform_points

DOUBTFUL, LOST = 1.0, 2.0
"""The verdicts `doubtful` and `lost` in the column `self_check`."""
AT_RETURN_S = 1.0
"""A sign within this time of the end of a loss is one of the return [s]."""
MAX_SPELLS = 6
"""More times are counted only."""


def self_check_sentence(check: Mapping[str, Any], run: Path | None = None) -> str:
    """Say what a run's own check found, from the group `self_check` of its metrics.

    run: its directory, for places to be those of report and pictures (else they are the map's), and for what the check
    said while driving
    """
    context = None if run is None else ReportContext.of(read_run(run))
    where = ""
    if check.get("place") is not None:
        where = f"{_place(check['place'])} of the map's frame"
        if context is not None:
            where = _place(_shown_place(context, check))
    found = f"{check['verdict']}{_first_sign(check, where)}"
    if context is None:
        return f"{found}: {check['reason']}"
    said = _said_while_driving(context, check)
    return f"{found}{said.sure}: {check['reason']}" + (f". {said.before}" if said.before else "")


def self_check_story(context: ReportContext) -> str:
    """Say what a run's own check found, in the frame and the time of the report; empty where it has none.

    Names how the first sign lies to the moment at which the run went wrong by the truth, when the filter said lost,
    and each time at which it had called the estimate lost before.
    """
    run = context.run
    check = run.metric("self_check")
    if not check:
        return ""
    where = ""
    if check.get("place") is not None:
        where = f"{_place(_shown_place(context, check))} in the plots below"
    story = f"The run's own check, without any truth: {check['verdict']}{_first_sign(check, where)}"
    returned = _return_at(context, check)
    if returned is not None:
        story += (
            ", as the pose comes back from where the truth shows it lost "
            f"({times_in_words([returned], context.start)}): walls that were drawn meanwhile stay in the map"
        )
    elif check.get("time_s") is not None and (moments := _moments(context)):
        moment = min(moments, key=lambda time: abs(time - check["time_s"]))
        story += f", {_lead(moment - check['time_s'], moment)}"
    said = _said_while_driving(context, check)
    story += f"{said.sure}{': ' if check.get('time_s') is None else '. It saw this: '}{check['reason']}."
    if said.before:
        story += f" {said.before}."
    return story + _right_in_a_bent_map(context, check)


def place_of_first_sign(context: ReportContext) -> NDArray[np.float64] | None:
    """Where the robot was at the first sign of a run's own check, in the frame of the report, (2,) [m]; None where
    there is none."""
    check = context.run.metric("self_check") or {}
    return None if check.get("place") is None else np.array(_shown_place(context, check))


@dataclass(frozen=True)
class _WhileDriving:
    """What the check said while driving, in words; each is empty where there is nothing to say."""

    sure: str
    """When it said lost from its first sign on, to be added to the verdict."""
    before: str
    """What it had said before its first sign, or in all of a run without one: a sentence without its full stop."""


def _said_while_driving(context: ReportContext, check: Mapping[str, Any]) -> _WhileDriving:
    """What a run's own check said while driving, by the table of steps."""
    steps, sure_from = context.run.steps, ""
    found = [] if steps is None else called_lost(steps)
    first = None if check.get("time_s") is None else context.start + check["time_s"]
    sure = [spell for spell in found if first is not None and spell.start >= first - 1e-6]
    if sure and check["verdict"] == "lost":
        sure_from = f"; while driving the check said lost {times_in_words(sure, context.start)}"
        found = [spell for spell in found if spell.start < sure[0].start]
    before = [(found[0].start, f"said lost {times_in_words(found, context.start)}")] if found else []
    doubtful = None if steps is None else _first_doubt(steps)
    if doubtful is not None and (first is None or doubtful < first):
        before.append(
            (doubtful, f"was doubtful from {at_time(doubtful - context.start)} on{_since(context, doubtful)}")
        )
    when = "While driving" if first is None else "Before that, while driving,"
    words = " and ".join(words for _, words in sorted(before))
    return _WhileDriving(sure_from, f"{when} it {words}" if words else "")


def called_lost(steps: Columns) -> list[Spell]:
    """When the filter's own check called the estimate lost while driving, by the table of a run."""
    if "self_check" not in steps:
        return []
    rows = updates(steps)
    stamps, lost = column(steps, "stamp")[rows], column(steps, "self_check")[rows] == LOST
    turns = np.flatnonzero(np.diff(np.r_[False, lost].astype(np.int8)))
    ends = [*turns[1::2].tolist(), None][: len(turns[::2])]
    return [
        Spell(float(stamps[start]), None if end is None else float(stamps[end]))
        for start, end in zip(turns[::2].tolist(), ends, strict=True)
    ]


def _first_doubt(steps: Columns) -> float | None:
    """Stamp of the first update at which the check was `doubtful` [s]; None where it never was."""
    if "self_check" not in steps:
        return None
    rows = updates(steps)
    doubts = np.flatnonzero(column(steps, "self_check")[rows] == DOUBTFUL)
    return float(column(steps, "stamp")[rows][doubts[0]]) if len(doubts) else None


def _since(context: ReportContext, doubtful: float) -> str:
    """Since when scans had contradicted the map before the check was doubtful at a stamp [s], in words: the time of a
    doubt while driving in `metrics.json`; empty where that is another one."""
    check = context.run.metric("self_check.while_driving") or {}
    stamp = check.get("stamp")
    if check.get("verdict") != "doubtful" or stamp is None or stamp > doubtful:
        return ""
    return f" (the scans that made it so began at {at_time(stamp - context.start)})"


def times_in_words(found: Sequence[Spell], start: float) -> str:
    """Times since the start [s] in words."""
    times = [
        f"from {at_time(spell.start - start)} " + ("on" if spell.end is None else f"to {at_time(spell.end - start)}")
        for spell in found[:MAX_SPELLS]
    ]
    if len(found) > MAX_SPELLS:
        times.append(f"{len(found) - MAX_SPELLS} times more")
    *others, last = times
    return f"{', '.join(others)} and {last}" if others else last


def _return_at(context: ReportContext, check: Mapping[str, Any]) -> Spell | None:
    """The loss, by the truth, that ends about the first sign of the run's own check; None where none does."""
    if check.get("time_s") is None or context.run.steps is None:
        return None
    stamp = context.start + check["time_s"]
    ended = [spell for spell in spells(context.run.steps, "lost") if spell.end is not None]
    return next((spell for spell in ended if abs(spell.end - stamp) <= AT_RETURN_S), None)


def _first_sign(check: Mapping[str, Any], where: str) -> str:
    """Time and place of the first sign; empty where there is none."""
    if check.get("time_s") is None:
        return ""
    sign = "the first sign that stays" if check["verdict"] == "lost" else "its first sign"
    return f"; {sign} is at {at_time(check['time_s'])}" + (f", at {where}" if where else "")


def _right_in_a_bent_map(context: ReportContext, check: Mapping[str, Any]) -> str:
    """Explain a first sign at which the estimate was close to the truth after it had drifted, as a sentence; empty
    where that was not so, or is unknown."""
    steps = context.run.steps
    if check.get("time_s") is None or steps is None or "error_m" not in steps:
        return ""
    stamp, drifted = context.start + check["time_s"], spells(steps, "drifted")
    off = [spell for spell in drifted + spells(steps, "lost") if spell.start <= stamp < (spell.end or np.inf)]
    rows = updates(steps) & np.isfinite(column(steps, "error_m"))
    if off or not rows.any() or not any(spell.start < stamp for spell in drifted):
        return ""
    nearest = int(np.argmin(np.abs(column(steps, "stamp")[rows] - stamp)))
    error = float(column(steps, "error_m")[rows][nearest])
    return (
        f" At {at_time(check['time_s'])} the pose was only {length(error)} off, but it had drifted before: a map that "
        "is bent may contradict the scans also where the pose is right."
    )


def _shown_place(context: ReportContext, check: Mapping[str, Any]) -> Sequence[float]:
    """Where the robot was at the first sign, in the frame of the report: by the truth where it is known."""
    truth, stamp = context.run.truth, check.get("stamp")
    if truth is not None and stamp is not None and truth.stamps[0] <= stamp <= truth.stamps[-1]:
        place: list[float] = truth.poses[int(np.argmin(np.abs(truth.stamps - stamp))), :2].tolist()
        return place
    estimated: list[float] = transform_points(context.T_frame_estimate, [check["place"][:2]])[0].tolist()
    return estimated


def _place(place: Sequence[float]) -> str:
    return f"({place[0]:.1f}, {place[1]:.1f}) m"


def _moments(context: ReportContext) -> list[float]:
    """Times since the start [s] at which the run went wrong, or was lost while driving, by the truth."""
    lost = [] if context.run.steps is None else spells(context.run.steps, "lost")
    own = [] if context.failure_time is None else [context.failure_time]
    return own + [spell.start - context.start for spell in lost]


def _lead(seconds: float, moment: float) -> str:
    """How a first sign lies to a moment of failure [s]."""
    if abs(seconds) < 0.05:
        return f"when the truth shows a loss too ({at_time(moment)})"
    return f"{abs(seconds):.1f} s {'before' if seconds >= 0.0 else 'after'} the truth shows a loss ({at_time(moment)})"
