# SPDX-License-Identifier: MIT
"""A verdict on a run, in plain words and headline figures, made from its metrics alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from eval.files.run_reader import RunFiles
from eval.filter.closing_loop import ClosingLoop, deaths_in_words, largest_closing_loop, longer_in_words
from eval.loss_watch import spells
from eval.mended import Mended, find_mended
from eval.report.bent_map import bent_before, cause_in_short, times_of_failure
from eval.report.check_story import self_check_story
from eval.report.report_context import ReportContext
from eval.wording import at_time, length, share, spread, up_to_a_tenth

Severity = Literal["good", "fair", "bad", "none"]
OUTCOME_SENTENCES: dict[str, tuple[str, Severity]] = {
    "ok": ("OK.", "good"),
    "drift": ("The path drifts, but no stretch or loop of it is broken.", "fair"),
    "broken loop": ("The map is broken: places visited twice do not meet.", "bad"),
    "lost": ("The estimate lost the robot.", "bad"),
    "collided": ("The robot collided before the drive was complete.", "bad"),
    "timeout": ("The time ran out before the drive was complete.", "bad"),
    "interrupted": ("The run was stopped by hand; this page shows what was there by then.", "none"),
    "failed": ("The run ended with an error; this page shows what was there by then.", "bad"),
    "unjudged": ("The run is complete; there is nothing to judge it by.", "none"),
}
"""First sentence and severity for each outcome (`eval.outcome`)."""
UNJUDGED_LEADS: dict[str, tuple[str, Severity]] = {
    "plausible": ("The run is complete. There is no truth to judge it by; its own check finds it plausible.", "none"),
    "doubtful": ("The run is complete. There is no truth to judge it by; its own check has doubts.", "fair"),
    "lost": ("The run's own check says that the estimate lost the robot.", "bad"),
}
"""First sentence and severity of an unjudged run for each verdict of its own check."""


SMALL_ERROR_M = 0.05
"""An error below the side of a cell of the map is not seen in it [m]."""
SOON_S = 20.0
"""A loss within this time after a return to old walls is said with it [s]."""


@dataclass(frozen=True)
class Headline:
    """One figure that a reader looks for first."""

    value: str
    label: str
    hint: str = ""
    """A value to compare it with."""


@dataclass(frozen=True)
class Loop:
    """What is said of the largest loop."""

    sentence: str
    """Empty where nothing is known of loops."""
    time: float | None = None
    """When to watch it, since the first scan [s]: the resampling in which most particles died, else the scan that
    closed it; None where none was seen."""


@dataclass(frozen=True)
class Verdict:
    """The judgement on a run."""

    outcome: str
    severity: Severity
    lead: str
    sentences: tuple[str, ...]
    mended: Mended | None
    """What was wrong before the final pass; None where nothing was."""
    loop: Loop
    headlines: tuple[Headline, ...]


def verdict(run: RunFiles) -> Verdict:
    """Return the verdict on a run, made from its `metrics.json`."""
    context = ReportContext.of(run)
    outcome = str(run.metrics.get("outcome", "unjudged"))
    lead, severity = OUTCOME_SENTENCES.get(outcome, (f"Outcome: {outcome}.", "none"))
    if outcome == "ok":
        lead = _lead_of_good_run(run)
    elif outcome in {"lost", "broken loop"} and run.estimate is not None and len(run.estimate):
        stamps = run.estimate.stamps
        lead += _moment_and_cause(context, float(stamps[0]), float(stamps[-1] - stamps[0]))
    elif outcome == "unjudged" and run.metric("self_check"):
        lead, severity = UNJUDGED_LEADS.get(str(run.metric("self_check.verdict")), (lead, severity))
    mended = find_mended(run.metrics, run.path)
    if mended is not None:
        lead = f"{_lead_of_final_path(run, outcome, lead)} {_lead_of_mended(mended)}"
    reason = str(run.metrics.get("outcome_reason") or run.metrics.get("reason") or "")
    sentences = [
        _mended_sentence(mended),
        self_check_story(context),
        _sentence(
            _without_ate(reason, outcome) if mended is None else f"The final path: {_without_ate(reason, outcome)}"
        ),
        _path_sentence(run),
        _relations_sentence(run),
        _map_sentence(run),
        _closed_loops_sentence(run),
    ]
    return Verdict(
        outcome=outcome,
        severity=severity,
        lead=lead,
        sentences=tuple(filter(None, sentences)),
        mended=mended,
        loop=_loop(context, None if mended is None else mended.stamp),
        headlines=tuple(_headlines(run)),
    )


def _lead_of_final_path(run: RunFiles, outcome: str, lead: str) -> str:
    """The first sentence of a run whose path was worse before the final pass."""
    if outcome != "ok":
        return lead.replace("The path", "The final path", 1)
    error = run.metric("trajectory.ate_rmse_m")
    return "The final path is OK" + ("." if error is None else f": trajectory error {length(error)}, no failed loops.")


def _lead_of_mended(mended: Mended) -> str:
    """Say in a sentence that the estimate before the final pass was worse, and when."""
    when = f"from {at_time(mended.stamp - mended.start)} on"
    if mended.driving is not None:
        most = mended.driving.stretches[0]
        end = "to the end" if most.end is None else f"to {at_time(most.end - mended.start)}"
        when = f"most of all from {at_time(most.start - mended.start)} {end}"
    which = mended.which[0].upper() + mended.which[1:]
    return f"{which} it was not: {mended.outcome}, {when}. The final pass has mended that."


def _mended_sentence(mended: Mended | None) -> str:
    """Say when and why the estimate was wrong before the final pass mended it; empty where it was not."""
    if mended is None:
        return ""
    which = mended.which[0].upper() + mended.which[1:]
    return f"{which} it went wrong at {at_time(mended.stamp - mended.start)}: {mended.cause.rstrip('.')}."


def _without_ate(reason: str, outcome: str) -> str:
    """The reason of an outcome; that of a good run without the trajectory error, which has a sentence of its own."""
    return reason.rpartition(", ATE")[0] or reason if outcome == "ok" else reason


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].rstrip('.')}." if text else ""


def _lead_of_good_run(run: RunFiles) -> str:
    """Name the largest figure that the judgement rests on, e.g. "OK: trajectory error 0.3 cm, no failed loops."."""
    for key, name in (("trajectory.ate_rmse_m", "trajectory error"), ("relations.trans_mean_m", "relation error")):
        error = run.metric(key)
        if error is not None:
            return f"OK: {name} {length(error)}{_of_which_path(run, key)}, no failed loops."
    return OUTCOME_SENTENCES["ok"][0]


def _of_which_path(run: RunFiles, key: str) -> str:
    """Name the path that a figure is of, with those of the others; empty where there was no final pass."""
    if not run.metric("refined"):
        return ""
    group, _, rest = key.partition(".")
    others = []
    for suffix, words in (("filter", "on the filter's own path"), ("online", "while driving")):
        value = run.metric(f"{group}_{suffix}.{rest}")
        if value is not None:
            others.append(f"{length(value)} {words}")
    return " after the final pass" + (f" ({', '.join(others)})" if others else "")


def _moment_and_cause(context: ReportContext, start: float, duration: float) -> str:
    """Name them in a sentence, e.g. "It is wrong from 219.7 s on, of 298 s: the wheels slipped."; empty if unknown."""
    failure = context.failure
    if failure is None or not failure.bad:
        return ""
    cause = cause_in_short(failure, bent_before(context.run.steps, failure, start))
    back = "" if failure.back is None else ", and comes back"
    times = f"{times_of_failure(failure, start)}, of {duration:.0f} s{back}"
    return f" It is wrong {times}{f': {cause}' if cause else ''}."


def _path_sentence(run: RunFiles) -> str:
    error = run.metric("trajectory.ate_rmse_m")
    if error is None:
        return ""
    which = " after the final pass" if run.metric("refined") else ""
    metres = f"{run.metric('trajectory.length_m'):.0f} m of path"
    text = f"The trajectory error{which} is {length(error)} over {metres} (root mean square, after alignment)"
    if run.metrics.get("outcome") == "ok":  # whose first sentence has the figure
        text = f"The trajectory error{which} is the root mean square over {metres}, after alignment"
    odometry = run.metric("trajectory.odometry.ate_rmse_m")
    return f"{text}; wheel odometry alone has {length(odometry)}." if odometry is not None else f"{text}."


def _relations_sentence(run: RunFiles) -> str:
    mean = run.metric("relations.trans_mean_m")
    if mean is None:
        return ""
    loops = run.metric("relations.loops.trans_mean_m")
    text = (
        f"Against {run.metric('relations.pairs')} hand-checked relations the error is "
        f"{spread(mean, run.metric('relations.trans_std_m'))} and {run.metric('relations.rot_mean_deg'):.2f} ± "
        f"{run.metric('relations.rot_std_deg'):.2f} degrees"
    )
    return f"{text}; {length(loops)} between visits more than 20 s apart." if loops is not None else f"{text}."


def _map_sentence(run: RunFiles) -> str:
    distance, coverage = run.metric(_wall_distance(run)), run.metric("map.coverage")
    if distance is None or coverage is None:
        return ""
    text = (
        f"The mean distance between mapped and true walls is {length(distance)}; "
        f"{share(coverage)} of the area that could be seen is mapped"
    )
    double = run.metric("map.double_wall_rate")
    return f"{text}; {share(double)} of the walls are double." if double is not None else f"{text}."


def _closed_loops_sentence(run: RunFiles) -> str:
    """Say which loops the final pass found, and which of them the filter had left open."""
    loops = run.metric("loops")
    if not loops or not loops["found"] or run.estimate is None or not len(run.estimate):
        return ""
    accepted = [loop for loop in loops["list"] if loop["accepted"]]
    gaps = [loop for loop in accepted if not loop["closed_by_filter"]]
    text = f"The final pass found {len(accepted)} {'loop' if len(accepted) == 1 else 'loops'}"
    if gaps:
        widest = max(gaps, key=lambda loop: loop["gap_m"])
        time = at_time(widest["stamp"] - float(run.estimate.stamps[0]))
        text += (
            f", of which the filter had left {len(gaps)} open: the widest gap, {length(widest['gap_m'])}, "
            f"at {time}, is closed now"
        )
    elif accepted:
        text += ", which the filter had closed" if len(accepted) == 1 else ", all of which the filter had closed"
    if rejected := loops["rejected"]:
        was = "match was" if rejected == 1 else "matches were"
        text += f". {rejected} {was} rejected, since the motion or other loops contradict"
    return f"{text}."


def _loop(context: ReportContext, told: float | None) -> Loop:
    """Describe the largest loop and what the particles did in it, or say that none was seen.

    told: the stamp of a moment [s] that the report has described before
    """
    run = context.run
    if run.metric("filter.loop_closures") == 0:
        return Loop("No loop was seen while driving: no scan met enough walls that had long been out of sight.")
    lost = [] if run.steps is None else spells(run.steps, "lost")
    first_loss = lost[0].start if lost else math.inf  # a loop that closes while lost closes nothing
    loop = None if run.steps is None else largest_closing_loop(run.steps, first_loss)
    if loop is None:
        return Loop("")
    start = context.start
    before = " before the estimate was lost" if lost else ""
    fell = "particles died" if loop.spread is None else "the particles' spread fell"
    which = f" in which {fell}" if loop.longer else ""
    at = at_time(loop.to_watch - start)
    text = (
        f"The largest loop{before}{which}, at {at}: {loop.metres:.0f} m of driving.{_particles_in(loop, start, told)}"
    )
    if loop.errors is not None:
        text += (
            " The position error while driving, aligned at the first scan as in the plot below and in the recording, "
            f"{_errors_in(loop, start, told)}"
        )
        largest = max(*loop.errors, *(loop.jump_errors or ()))
        text += ": little had to be corrected." if largest < SMALL_ERROR_M else "."
    if longer := longer_in_words(loop, start):
        text += f" {longer[0].upper()}{longer[1:]}."
    if lost and first_loss - loop.stamp <= SOON_S:
        later = first_loss - loop.to_watch
        text += f" The estimate was lost {abs(later):.1f} s {'later' if later >= 0.0 else 'before'}."
    return Loop(text, up_to_a_tenth(loop.to_watch - start))


def _errors_in(loop: ClosingLoop, start: float, told: float | None) -> str:
    """How the error changed in a loop, in the order of time: before it, as another particle became the best unless none
    did, or that is told, and when the particles had settled."""
    assert loop.errors is not None
    first, last = loop.errors
    began = "" if loop.began == loop.to_watch else " old walls came into view"
    words, settled = [f"was {length(first)} before{began}"], loop.settled
    if loop.jump is not None and loop.jump_errors is not None and loop.jump[1] != told and loop.jump[1] <= settled:
        before, after = loop.jump_errors
        at = "then" if loop.jump[1] == loop.to_watch else f"at {at_time(loop.jump[1] - start)}"
        words.append(f"went from {length(before)} to {length(after)} {at}, as another particle became the best")
        if loop.jump[1] == settled:  # that says the rest
            return ", and ".join(words)
    at = "then" if settled == loop.to_watch else f"at {at_time(settled - start)}"
    return f"{', '.join(words)}{',' if len(words) > 1 else ''} and was {length(last)} {at}"


def _particles_in(loop: ClosingLoop, start: float, told: float | None) -> str:
    """What the particles did in a loop, as a sentence; empty where it is unknown."""
    if loop.particles == 1:
        return " With a single particle there is no choice between histories."
    words = deaths_in_words(loop, told)
    if not words:
        return ""
    text = f" Then {words}"
    if loop.spread is not None and loop.least_spread is not None:
        weighted = "spread" if loop.most_died is not None else "spread, in which each counts by its weight,"
        least, stamp = loop.least_spread
        began = (
            "" if loop.began == loop.to_watch else f" at {at_time(loop.began - start)}, when old walls came into view,"
        )
        to = "then" if stamp == loop.to_watch else f"at {at_time(stamp - start)}"
        text += f", and their {weighted} went from {length(loop.spread)}{began} to {length(least)} {to}"
    return f"{text}."


def _wall_distance(run: RunFiles) -> str:
    """Key of the wall distance [m]: against the exact walls of the world where they are known, as in the summary."""
    exact = "map.wall_distance_subcell_m"
    return "map.wall_distance_m" if run.metric(exact) is None else exact


def _headlines(run: RunFiles) -> list[Headline]:
    found = []

    def add(key: str, form: str, label: str, hint: str = "") -> None:
        value = run.metric(key)
        if value is not None:
            found.append(Headline(length(value) if form == "length" else form.format(value), label, hint))

    odometry = run.metric("trajectory.odometry.ate_rmse_m")
    add(
        "trajectory.ate_rmse_m",
        "length",
        "trajectory error",
        f"odometry: {length(odometry)}" if odometry else "ATE rmse",
    )
    add("trajectory.heading_rmse_deg", "{:.2f}°", "heading error", "rmse")
    std = run.metric("relations.trans_std_m")
    add("relations.trans_mean_m", "length", "relation error", f"± {length(std)}" if std is not None else "")
    add("relations.rot_mean_deg", "{:.2f}°", "relation error, rotation", "mean")
    add(_wall_distance(run), "length", "walls from truth", "mean, both ways")
    add("map.f1_1_cells", "{:.3f}", "map agreement", "F1 of walls within a cell")
    count = run.metric("mean_particles")
    add("filter.mean_ess", "{:.1f}", "mean effective sample size", f"of {count:.0f}" if count is not None else "")
    add("realtime_factor", "{:.1f}×", "real time", f"{run.metric('duration_s') or 0.0:.0f} s of data")
    return found
