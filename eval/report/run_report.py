# SPDX-License-Identifier: MIT
"""The report of one run: one HTML file that opens anywhere, made from the run directory alone."""

from __future__ import annotations

import base64
import os
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from eval.files.run_reader import RunFiles, read_run
from eval.filter.closing_loop import ClosingLoop, largest_closing_loop
from eval.filter.step_table import column, updates
from eval.first_failure import BAD_DEG, BAD_M
from eval.loss_watch import spells
from eval.mended import Mended
from eval.report import plots
from eval.report.bent_map import bent_before, cause_in_short
from eval.report.check_story import times_in_words
from eval.report.map_plots import failure_over_map, failure_plots, loop_plots, map_plots, path_plots
from eval.report.page import Plot, flat, render
from eval.report.report_context import ReportContext
from eval.report.time_plots import error_plots, filter_plots, moment_plots
from eval.report.verdict import verdict
from eval.wording import at_time, length, share, up_to_a_tenth
from slam.occupancy import OccupancyGrid

FAR_M = 0.1
"""A match that differs from the filter's path by more is explained where the loop counts as closed [m]."""


class Recording(Protocol):
    """What a report takes from the recording of a run."""

    @property
    def another_best(self) -> NDArray[np.float64]:
        """Times at which the pose while driving moved because another particle became the best, in seconds since the
        first scan, (n,)."""

    def png(self, time: float) -> bytes:
        """Draw a moment, in seconds since the first scan."""

    def side_by_side(self, before: float, at: float) -> bytes:
        """Draw map and scan at two moments, in seconds since the first scan, around the same place on one scale."""

    def map_at(self, time: float) -> OccupancyGrid | None:
        """Return the map while driving at a moment, in seconds since the first scan; None where there was none."""


class MomentPlots:
    """The pictures of moments of a report, each of which it holds once."""

    def __init__(self, recording: Recording | None, news: Callable[[str], None] | None = None) -> None:
        """recording: draws them; None = nothing can be drawn.  news: is told which moment is drawn next."""
        self._recording, self._news = recording, news
        self._titles: dict[float, str] = {}  # of those that were drawn, by their time

    @property
    def possible(self) -> bool:
        """Whether anything can be drawn."""
        return self._recording is not None

    def draw(self, name: str, time: float) -> Plot:
        """Return the picture of a time since the first scan [s]; where the report has it already, a plot without source
        whose title says which it is."""
        assert self._recording is not None
        title = f"{name}, {at_time(time)}"
        if time in self._titles:
            return Plot(f"{title}: the picture “{self._titles[time]}” above.", "")
        self._titles[time] = title
        self.say(f"drawing {at_time(time)}")
        return Plot(title, _png_uri(self._recording.png(time)))

    def draw_pair(self, before: float, at: float) -> Plot:
        """Return the picture of map and scan at two times since the first scan [s]."""
        assert self._recording is not None
        title = f"Map and scan at the update before, {at_time(before)}, and where it went wrong, {at_time(at)}"
        self.say(f"drawing {at_time(before)} and {at_time(at)}")
        return Plot(title, _png_uri(self._recording.side_by_side(before, at)))

    def say(self, what: str) -> None:
        """Say what comes next, if anybody listens."""
        if self._news is not None:
            self._news(what)


def _png_uri(png: bytes) -> str:
    """A PNG as a `data:` address for HTML."""
    return "data:image/png;base64," + base64.b64encode(png).decode()


def write_report(
    run_directory: str | os.PathLike[str],
    recording: Recording | None = None,
    news: Callable[[str], None] | None = None,
) -> Path:
    """Write `report.html` into a run directory, from its other files, and return its path.

    recording: draws the moments that the report names; None = they are named only.  news: is told what is drawn next

    Raises RunFilesError for a directory that holds no run, ValueError for damaged files in it.
    """
    run = read_run(run_directory)
    page = render("report.html.j2", **_template_values(run, recording, news))
    path = run.path / "report.html"
    with atomic_write(path) as aside:
        aside.write_text(page, encoding="utf-8")
    return path


def _template_values(run: RunFiles, recording: Recording | None, news: Callable[[str], None] | None) -> dict[str, Any]:
    context = ReportContext.of(run)
    another_best = np.zeros(0) if recording is None else recording.another_best
    moments = MomentPlots(recording, news)  # in the order of the page: a picture stands where it is named first
    failure, judged = context.failure, verdict(run)
    mended = judged.mended
    moment = failure.stamp if failure and failure.bad else mended.stamp if mended else None
    failure_pictures = _failure_pictures(context, moments)
    mended_pictures = _mended_pictures(context, mended, moments)
    loop = _largest_loop(context)
    loop_pictures = _loop_pictures(context, loop, moments)
    largest_error_picture = _picture_of_largest_error(context, mended, moments)
    moments.say("plots")
    return {
        "name": run.name,
        "path": shlex.quote(str(run.path.resolve())),  # a command that works wherever it is typed
        "title": _title(run),
        "verdict": judged,
        "metrics": run.metrics,
        "command": run.config.get("command", ""),
        "failure": failure,
        "cause": None if failure is None else cause_in_short(failure, bent_before(run.steps, failure, context.start)),
        "back_time": None if failure is None or failure.back is None else up_to_a_tenth(failure.back - context.start),
        "failure_time": up_to_a_tenth(failure.stamp - context.start) if failure else None,
        "shown_time": failure.time_to_watch(context.run.estimate.stamps) if failure and context.run.estimate else None,
        "drift_before": _drift_before(context),
        "lost_while_driving": _lost_while_driving(context),
        "earlier_loss_time": _earlier_loss(context),
        "blips": sorted(failure.blips, key=lambda blip: blip.severity, reverse=True) if failure else [],
        "has_updates": run.steps is not None,
        "limits": (BAD_M, BAD_DEG),
        "failure_plots": list(_failure_plots(context, recording)),
        "failure_pictures": failure_pictures,
        "mended_pictures": mended_pictures,
        "moment_plots": list(moment_plots(context, another_best, moment)),
        "start": context.start,
        "length": length,
        "share": share,
        "at_time": at_time,
        "maps": list(map_plots(context)),
        "path_plots": [*path_plots(context), *loop_plots(context)],
        "error_plots": list(error_plots(context, another_best, moment)),
        "filter_plots": list(filter_plots(context)),
        "rpe": {_spaced(key): row for key, row in (run.metric("trajectory.rpe") or {}).items()},
        "relations": _relation_rows(run),
        "loops": _loop_rows(run, context.start),
        "loop_pictures": loop_pictures,
        "loop_judged": _final_pass_of(context, loop),
        "largest_error_picture": largest_error_picture,
        "calibration": _calibration_plot(run),
        "provenance": {key: dict(flat(run.config.get(key, {}))) for key in ("versions", "machine", "inputs")},
        "settings": dict(flat(run.config.get("settings", {}))),
        "all_metrics": {key: _number(value) for key, value in flat(run.metrics) if not isinstance(value, list)},
    }


def _lost_while_driving(context: ReportContext) -> str:
    """When the estimate was lost by its recording, which judges the pose while driving; empty where that is unknown."""
    if context.run.steps is None or context.run.truth is None:
        return ""
    found = spells(context.run.steps, "lost")
    if not found:
        return "The recording judges the pose while driving, and does not call it lost at any time."
    return f"The recording judges the pose while driving, and calls it lost {times_in_words(found, context.start)}."


def _earlier_loss(context: ReportContext) -> float | None:
    """When to watch the first loss before the moment of the failure, from which the estimate came back, since the start
    [s]; None where there was none."""
    if context.run.steps is None or context.failure is None or not context.failure.bad:
        return None
    found = [spell for spell in spells(context.run.steps, "lost") if (spell.end or np.inf) < context.failure.stamp]
    return up_to_a_tenth(found[0].start - context.start) if found else None


def _drift_before(context: ReportContext) -> str:
    """How the map was bent before the moment of a failure; empty where it was not, or where that is unknown."""
    failure = context.failure
    words = "" if failure is None else bent_before(context.run.steps, failure, context.start)
    return words and f"{words[0].upper()}{words[1:]}, so that a wall seen before and after may lie in it twice."


def _title(run: RunFiles) -> str:
    """The log or world of the run, and the name of its directory where that does not name it."""
    settings = run.config.get("settings", {})
    source = Path(str(settings.get("log") or settings.get("world") or "")).name
    subject = source.split(".")[0] if settings.get("log") else source.removesuffix(".toml").removesuffix(".yaml")
    return run.name if subject in run.name else f"{subject} ({run.name})"


def _spaced(piece: str) -> str:
    """Write `10s` as `10 s`."""
    return f"{piece[:-1]}\N{NO-BREAK SPACE}{piece[-1]}"


def _number(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _calibration_plot(run: RunFiles) -> Plot | None:
    bins = run.metric("map.calibration")
    if not bins:
        return None
    stated, observed, cells = ([part[key] for part in bins] for key in ("stated", "observed", "cells"))
    return Plot(
        "Calibration of the map's probabilities",
        plots.calibration(stated, observed, cells),
        "Cells are grouped by the probability that the map states. Vertical: the share of them that is truly occupied.",
    )


def _loop_rows(run: RunFiles, start: float) -> list[dict[str, str]]:
    """The loops that the final pass found, in words, in the order of time."""
    rows = []
    for loop in sorted(run.metric("loops.list") or [], key=lambda loop: loop["stamp"]):
        rows.append(
            {
                "time": at_time(loop["stamp"] - start),
                "before": at_time(loop["seen_before_stamp"] - start),
                "driven": length(loop["length_m"]),
                "overlap": length(loop["overlap_m"]),
                "gap": _gap(loop),
                "match_error": _loop_error(loop, "match_error"),
                "filter_error": _loop_error(loop, "filter_error"),
                "decision": _decision(loop) + _why_closed(loop),
            }
        )
    return rows


def _loop_error(loop: dict[str, Any], key: str) -> str:
    """Position and heading error of a motion between two visits; empty without truth."""
    metres = loop.get(f"{key}_m")
    return "" if metres is None else f"{length(metres)}, {loop[f'{key}_deg']:.1f}°"


def _largest_loop(context: ReportContext) -> ClosingLoop | None:
    """The largest loop that closed before the estimate was lost; None where none was seen."""
    steps = context.run.steps
    if steps is None:
        return None
    lost = spells(steps, "lost")
    return largest_closing_loop(steps, lost[0].start if lost else np.inf)


def _loop_pictures(context: ReportContext, loop: ClosingLoop | None, moments: MomentPlots) -> list[Plot]:
    """The largest loop at the time by which it is named, before it, and after it; nothing where none was seen, or
    nothing can be drawn."""
    if not moments.possible or loop is None or context.run.steps is None:
        return []
    deaths = "" if loop.most_died is None else ", as particles die"
    times = {loop.began: "Before the largest loop, as old walls come into view again"}
    if loop.settled > loop.to_watch and not spells(context.run.steps, "lost"):
        times[loop.settled] = "After the largest loop, when the spread of the particles is smallest"
    times[loop.to_watch] = f"The largest loop{deaths}"
    return [moments.draw(times[stamp], up_to_a_tenth(stamp - context.start)) for stamp in sorted(times)]


def _final_pass_of(context: ReportContext, loop: ClosingLoop | None) -> str:
    """What the final pass says of the loops that it found at the time of the largest one, as a sentence; empty where it
    found none then."""
    if loop is None:
        return ""
    found = [row for row in context.run.metric("loops.list") or [] if loop.began <= row["stamp"] <= loop.end]
    parts = [
        f"at {at_time(row['stamp'] - context.start)} {_decision(row)} ({_gap(row)} apart)"
        for row in sorted(found, key=lambda row: row["stamp"])
    ]
    return f"What the final pass says of the loops at this time: {'; '.join(parts)}." if parts else ""


def _decision(loop: dict[str, Any]) -> str:
    """What became of a loop that the final pass found."""
    if not loop["accepted"]:
        return "rejected"
    return "closed by the filter" if loop["closed_by_filter"] else "left open, closed now"


def _why_closed(loop: dict[str, Any]) -> str:
    """Explain a loop that counts as closed although the match of its walls lies elsewhere; empty for others."""
    far = loop["gap_m"] > FAR_M and loop["accepted"] and loop["closed_by_filter"]
    return ": the walls agree along its path too" if far else ""


def _gap(loop: dict[str, Any]) -> str:
    """By how much the match of a loop and the filter's path differ."""
    return f"{length(loop['gap_m'])}, {loop['gap_deg']:.1f}°"


def _failure_plots(context: ReportContext, recording: Recording | None) -> Iterator[Plot]:
    """The scan where it went wrong; of a run that does not come back also over the map that it had just before, in
    which a wall may lie twice."""
    yield from failure_plots(context)
    failure = context.failure
    if recording is None or failure is None or not failure.bad:
        return
    before = _update_before(context, failure.stamp)
    grid = None if before is None else recording.map_at(before)
    plot = None if before is None or grid is None else failure_over_map(context, grid, before)
    if plot is not None:
        yield plot


def _failure_pictures(context: ReportContext, moments: MomentPlots) -> list[Plot]:
    """The moment that shows a failure, and the update before it; nothing where there is none, or nothing can be
    drawn."""
    run, failure = context.run, context.failure
    if not moments.possible or run.estimate is None or failure is None or not failure.bad:
        return []
    at = failure.time_to_watch(run.estimate.stamps)
    if at is None:
        return []
    return _pictures_of_moment(moments, "Where it went wrong", _update_before(context, failure.stamp), at)


def _update_before(context: ReportContext, stamp: float) -> float | None:
    """The last update before a stamp [s], since the start [s]; None where none is known."""
    steps = context.run.steps
    if steps is None:
        return None
    stamps = column(steps, "stamp")[updates(steps)]
    earlier = stamps[stamps < stamp - 1e-6]
    return up_to_a_tenth(float(earlier[-1]) - context.start) if len(earlier) else None


def _pictures_of_moment(moments: MomentPlots, name: str, before: float | None, at: float) -> list[Plot]:
    """A moment, and where the update before it is known, the maps of both side by side; times since the start [s]."""
    if before is None or before >= at:
        return [moments.draw(name, at)]
    return [moments.draw_pair(before, at), moments.draw(name, at)]


def _picture_of_largest_error(context: ReportContext, mended: Mended | None, moments: MomentPlots) -> Plot | None:
    """The pose while driving at its worst, of a run that did not go wrong; None where nothing can be drawn, or where
    that is among the pictures of what the final pass has mended."""
    steps, failure = context.run.steps, context.failure
    bad = failure is not None and failure.bad
    if not moments.possible or bad or mended is not None or steps is None or "error_m" not in steps:
        return None
    errors = np.where(updates(steps), column(steps, "error_m"), np.nan)
    if not np.isfinite(errors).any():
        return None
    worst = column(steps, "stamp")[np.nanargmax(errors)] - context.start
    return moments.draw("The largest error of the pose while driving", up_to_a_tenth(worst))


def _mended_pictures(context: ReportContext, mended: Mended | None, moments: MomentPlots) -> list[Plot]:
    """The moment that the final pass has mended, the update before it where it came suddenly, and the largest error;
    nothing where nothing was mended, or nothing can be drawn."""
    if not moments.possible or mended is None or context.run.steps is None:
        return []
    at, sudden = mended.time_to_watch, mended.driving is None or mended.driving.stretches[0].sudden
    before = _update_before(context, mended.stamp) if sudden else None
    pictures = _pictures_of_moment(moments, f"Where it went wrong {mended.which}", before, at)
    if mended.driving is not None:
        worst = up_to_a_tenth(mended.driving.worst.worst - context.start)
        if worst not in (before, at):
            pictures.append(moments.draw("The largest error of the pose while driving", worst))
    return pictures


def _relation_rows(run: RunFiles) -> list[tuple[str, dict[str, Any]]]:
    rows = [("all pairs", run.metric("relations")), ("up to 20 s apart", run.metric("relations.short"))]
    rows.append(("loops, further apart", run.metric("relations.loops")))
    return [(name, row) for name, row in rows if row]
