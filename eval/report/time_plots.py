# SPDX-License-Identifier: MIT
"""Plots of a run over time: its errors, and what the filter did."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from eval.consistency import LEVEL, chi_square
from eval.filter.nees import nees
from eval.filter.step_table import Columns, column, updates
from eval.report import plots
from eval.report.page import Plot
from eval.report.report_context import ReportContext
from eval.wording import at_time, length, share

ONLINE = "#a5b8cf"
"""Colour of the errors while driving."""
LOOPS = "#2b8a3e"
ANOTHER_BEST = "#0b7285"
FROM_START = "Both paths are aligned at the first scan, as in the recording and in its event log."
"""How the errors over time are measured, in all plots of a report and in the recording."""
JUMPS = " Diamonds: another particle became the best, and the pose while driving jumps to its history."
MAX_CM = 1.0
"""Larger errors are drawn in metres [m]."""
AROUND_S = 15.0
"""Errors around the moment of a failure are drawn from this long before it to this long after it [s]."""
PEAK_S, PEAK_SHARE = 0.5, 0.5
"""A peak is named that is above this share of its height for less than so long [s]."""
MIN_NEES = 1e-3
"""Smaller values are drawn here: the axis is logarithmic."""


def error_plots(
    context: ReportContext, another_best: NDArray[np.float64], stamp: float | None = None
) -> Iterator[Plot]:
    """Position and heading error over time, while driving and in the end; nothing without truth.

    another_best (n,): times at which another particle became the best, since the first scan [s];  stamp: when it went
    wrong [s], None = it did not
    """
    run = context.run
    if context.errors is None or run.estimate is None:
        return
    time = run.estimate.stamps[context.rows] - context.start
    metres, degrees = context.errors_from_start()
    curves: list[tuple[str, NDArray[np.float64], NDArray[np.float64], str]] = []
    if run.steps is not None and "error_m" in run.steps and len(column(run.steps, "error_m")) == len(run.estimate):
        live_metres, live_degrees = (column(run.steps, name)[context.rows] for name in ("error_m", "error_deg"))
        curves.append(("while driving", live_metres, live_degrees, ONLINE))
    curves.append(("final", metres, degrees, plots.ESTIMATE))
    unit, scale = ("m", 1.0) if np.nanmax([np.nanmax(curve[1]) for curve in curves]) > MAX_CM else ("cm", 100.0)
    position: list[plots.Series] = [(name, scale * metres, colour) for name, metres, _, colour in curves]
    heading: list[plots.Series] = [(name, degrees, colour) for name, _, degrees, colour in curves]
    caption = FROM_START
    marks = {} if run.steps is None else _event_marks(run.steps, context.start)
    if len(curves) > 1:
        caption += " “While driving”: the best particle at that moment. “Final”: the path estimated in the end."
        if len(another_best):
            marks |= _jump_marks(another_best, time, scale * curves[0][1])
            caption += JUMPS
    ate = run.metric("trajectory.ate_rmse_m")
    if ate is not None:
        caption += (
            f" The trajectory error (ATE, {length(ate)}) is that of the final path after alignment over all poses: an "
            "error of the first heading does not count there; here it turns the whole path, and 1° is 17 cm after 10 m."
        )
    cursor = None if stamp is None else stamp - context.start
    source = plots.over_time(time, position, f"error [{unit}]", marks=marks, cursor=cursor)
    yield Plot("Position error", source, caption)
    yield Plot("Heading error", plots.over_time(time, heading, "error [deg]", cursor=cursor), FROM_START)


def moment_plots(context: ReportContext, another_best: NDArray[np.float64], stamp: float | None) -> Iterator[Plot]:
    """Position and heading error of the pose while driving about a moment [s]; nothing without both.

    another_best (n,): times at which another particle became the best, since the first scan [s]
    """
    steps = context.run.steps
    if steps is None or stamp is None or "error_m" not in steps:
        return
    stamps = column(steps, "stamp")
    near = np.abs(stamps - stamp) <= AROUND_S
    if not np.isfinite(column(steps, "error_m")[near]).any():
        return
    around = {name: np.asarray(values)[near] for name, values in steps.items()}
    time, cursor = stamps[near] - context.start, stamp - context.start
    jumped = another_best[(another_best >= time[0]) & (another_best <= time[-1])]
    caption = f"Of the pose while driving. {FROM_START}{JUMPS if len(jumped) else ''}"
    for name, key, unit in (("Position", "error_m", "m"), ("Heading", "error_deg", "deg")):
        curve: list[plots.Series] = [("while driving", column(around, key), plots.ESTIMATE)]
        marks = _event_marks(around, context.start)
        marks |= _jump_marks(jumped, time, column(around, key))
        source = plots.over_time(time, curve, f"error [{unit}]", marks=marks, cursor=cursor)
        yield Plot(f"{name} error around the moment", source, f"{caption}{_peak_in_words(around, key, context.start)}")


def _peak_in_words(steps: Columns, key: str, start: float) -> str:
    """Name the largest of the errors in a column where it is soon over, and the odometry's jump that made it, since a
    start [s]; empty where it lasts."""
    stamps, errors = column(steps, "stamp"), np.nan_to_num(column(steps, key))
    peak = int(np.argmax(errors))
    low = errors < PEAK_SHARE * errors[peak]
    before, after = stamps[low & (stamps < stamps[peak])], stamps[low & (stamps > stamps[peak])]
    if len(before) == 0 or len(after) == 0 or after[0] - before[-1] >= PEAK_S:
        return ""
    size = length(errors[peak]) if key == "error_m" else f"{errors[peak]:.0f}°"
    words = f" The peak of {size} at {at_time(stamps[peak] - start)} is over after {after[0] - before[-1]:.1f} s"
    jumped = np.nan_to_num(column(steps, "odometry_jumped")) == 1.0 if "odometry_jumped" in steps else low & ~low
    if (jumped & (stamps > before[-1]) & (stamps <= after[0])).any():
        words += ": the odometry moved further between two scans than a robot drives, and the next scans put it right"
    return f"{words}."


def _jump_marks(
    at: NDArray[np.float64], time: NDArray[np.float64], error: NDArray[np.float64]
) -> dict[str, plots.Marks]:
    """Marks at the times `at` (k,) on the curve of an error (n,) over time (n,): the values are those after a jump."""
    rows = np.clip(np.searchsorted(time, at - 1e-3), 0, len(time) - 1)
    return {"another best particle": plots.Marks(time[rows], ANOTHER_BEST, error[rows])}


def _event_marks(steps: Columns, start: float) -> dict[str, plots.Marks]:
    """Times [s] of resamplings and of returns to old walls, with their colours."""
    stamps = column(steps, "stamp") - start
    return {
        "resampled": plots.Marks(stamps[column(steps, "resampled") == 1.0], plots.ODOMETRY),
        "old walls in view again": plots.Marks(stamps[column(steps, "loop_closed") == 1.0], LOOPS),
    }


def filter_plots(context: ReportContext) -> Iterator[Plot]:
    """What the particle filter did at each update; nothing where no update is known."""
    steps = context.run.steps
    if steps is None or not updates(steps).any():
        return
    start, cursor = context.start, context.failure_time
    if np.nanmax(_at_updates(steps, "particles")) > 1.0:  # there is nothing to choose among one
        yield _sample_size_plot(steps, start, cursor)
        yield _ancestry_plot(steps, start, cursor)
    for plot in (
        _spread_plot(steps, start, cursor),
        _matching_plot(steps, start, cursor),
        _stages_plot(steps, start),
        _nees_plot(steps, start),
    ):
        if plot is not None:
            yield plot


def _at_updates(steps: Columns, name: str) -> NDArray[np.float64]:
    """A column at the scans that the filter took in, (updates,)."""
    return column(steps, name)[updates(steps)]


def _sample_size_plot(steps: Columns, start: float, cursor: float | None) -> Plot:
    time = _at_updates(steps, "stamp") - start
    curves: list[plots.Series] = [
        ("particles", _at_updates(steps, "particles"), plots.QUIET),
        ("effective", _at_updates(steps, "ess"), plots.ESTIMATE),
    ]
    marks = {"resampled": plots.Marks(time[_at_updates(steps, "resampled") == 1.0], plots.ODOMETRY)}
    source = plots.over_time(time, curves, "particles", marks=marks, cursor=cursor)
    return Plot("Effective sample size", source, "Number of particles that carry weight, before resampling.")


def _ancestry_plot(steps: Columns, start: float, cursor: float | None) -> Plot:
    time, ancestors = _at_updates(steps, "stamp") - start, _at_updates(steps, "unique_ancestors")
    curves: list[plots.Series] = [("unique ancestors", ancestors, plots.ESTIMATE)]
    return Plot(
        "Particle ancestry",
        plots.over_time(time, curves, "ancestors", cursor=cursor),
        "Number of ancestors that have living descendants. At one, all particles share their past: the filter can no "
        "longer correct older loops. The count then starts again.",
    )


def _spread_plot(steps: Columns, start: float, cursor: float | None) -> Plot | None:
    """Spread of the particles; None with a single one, or in tables of older releases."""
    if "spread_m" not in steps or not np.nanmax(_at_updates(steps, "particles")) > 1.0:
        return None
    curves: list[plots.Series] = [("spread", 100.0 * _at_updates(steps, "spread_m"), plots.ESTIMATE)]
    if not np.isfinite(np.asarray(curves[0][1])).any():
        return None
    marks = _event_marks(steps, start)
    return Plot(
        "Spread of the particles",
        plots.over_time(_at_updates(steps, "stamp") - start, curves, "spread [cm]", marks=marks, cursor=cursor),
        "Standard deviation of their positions, in which each particle counts by its weight. It grows while the robot "
        "sees new places, and falls when walls come back into view: as the particles whose maps do not fit them lose "
        "weight, not only when they die.",
    )


def _matching_plot(steps: Columns, start: float, cursor: float | None) -> Plot | None:
    """Shares of matched beams and failed particles; None for the motion proposal, which matches nothing."""
    share = 100.0 * _at_updates(steps, "matched_share")
    failed = 100.0 * _at_updates(steps, "match_failures") / _at_updates(steps, "particles")
    if not np.nansum(share) + np.nansum(failed) > 0.0:
        return None
    curves: list[plots.Series] = [
        ("beams on known walls", share, plots.ESTIMATE),
        ("particles that failed", failed, plots.BAD),
    ]
    return Plot(
        "Scan matching",
        plots.over_time(_at_updates(steps, "stamp") - start, curves, "share [%]", cursor=cursor),
        "Fewer beams match where the robot sees new places. Failed matching is what breaks maps.",
    )


def _stages_plot(steps: Columns, start: float) -> Plot | None:
    """Time of the stages of an update; None where no time was measured."""
    parts = {
        stage: 1e3 * _at_updates(steps, f"{stage}_s")
        for stage in plots.STAGES
        if np.nansum(_at_updates(steps, f"{stage}_s")) > 0.0
    }
    if not parts:
        return None
    source = plots.stacked_over_time(_at_updates(steps, "stamp") - start, parts, "time per update [ms]")
    particles = _at_updates(steps, "particles")[-1]
    return Plot("Where the time goes", source, "" if particles == 1.0 else f"All {particles:.0f} particles together.")


def _inside_in_words(inside: float) -> str:
    """A sentence on the share of the updates at which the truth lay within the ellipsoid of the level `LEVEL`."""
    said = "as it should" if inside >= LEVEL - 0.05 else "the covariance is too small, as in most particle filters"
    return f"The truth lay within the {share(LEVEL)} ellipsoid at {share(inside)} of the updates: {said}."


def _nees_plot(steps: Columns, start: float) -> Plot | None:
    """The squared error against the stated covariance; None where fewer than two values are known."""
    rows, values, _ = nees(steps)
    if len(rows) < 2:
        return None
    low, high = (chi_square(part, 3) for part in ((1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0))
    time = column(steps, "stamp")[rows] - start
    curves: list[plots.Series] = [("NEES", np.maximum(values, MIN_NEES), plots.ESTIMATE)]
    return Plot(
        "Consistency (NEES)",
        plots.over_time(time, curves, "NEES", band=(low, high), log=True),
        "Squared error divided by the stated covariance. Green band: the covariance is right. Above the band: the "
        f"filter underestimates its error. {_inside_in_words(float(np.mean(values <= chi_square(LEVEL, 3))))}",
    )
