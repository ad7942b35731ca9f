# SPDX-License-Identifier: MIT
"""Plots of a run over time: its errors, and what the filter did."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from eval.filter.nees import LEVEL, chi_square, nees
from eval.filter.step_table import Columns, column, updates
from eval.report import plots
from eval.report.page import Plot
from eval.report.report_context import ReportContext
from eval.trajectory.association import associate
from eval.trajectory.errors import AbsoluteError, absolute_error
from eval.trajectory.trajectory import Trajectory

ONLINE = "#a5b8cf"
"""Colour of the errors while driving."""
LOOPS = "#2b8a3e"
AROUND_S = 15.0
"""Errors around the moment of a failure are drawn from this long before it to this long after it [s]."""
MIN_NEES = 1e-3
"""Smaller values are drawn here: the axis is logarithmic."""


def error_plots(context: ReportContext) -> Iterator[Plot]:
    """Position and heading error over time, while driving and in the end; nothing without truth."""
    run, errors = context.run, context.errors
    if errors is None or run.estimate is None:
        return
    time = run.estimate.stamps[context.rows] - context.start
    position: list[plots.Series] = [("final", 100.0 * errors.translation_errors, plots.ESTIMATE)]
    heading: list[plots.Series] = [("final", errors.rotation_errors, plots.ESTIMATE)]
    live = _online_errors(context)
    if live is not None and len(live.translation_errors) == len(time):
        position.insert(0, ("while driving", 100.0 * live.translation_errors, ONLINE))
        heading.insert(0, ("while driving", live.rotation_errors, ONLINE))
    aligned = "After SE(2) alignment of all poses."
    caption = f"{aligned} “While driving”: the best particle at that moment. “Final”: the path estimated in the end."
    cursor, marks = context.failure_time, {} if run.steps is None else _event_marks(run.steps, context.start)
    yield Plot(
        "Position error",
        plots.over_time(time, position, "error [cm]", marks=marks, cursor=cursor),
        caption if live is not None else aligned,
    )
    yield Plot("Heading error", plots.over_time(time, heading, "error [deg]", cursor=cursor), aligned)


def moment_plots(context: ReportContext) -> Iterator[Plot]:
    """Position and heading error of the pose while driving about the moment of a failure; nothing without both."""
    steps, failure = context.run.steps, context.failure
    if steps is None or failure is None or not failure.bad or "error_m" not in steps:
        return
    stamps = column(steps, "stamp")
    near = np.abs(stamps - failure.stamp) <= AROUND_S
    if not np.isfinite(column(steps, "error_m")[near]).any():
        return
    around = {name: np.asarray(values)[near] for name, values in steps.items()}
    time, cursor = stamps[near] - context.start, context.failure_time
    caption = "Of the pose while driving, with both paths aligned at the first scan."
    for name, key, unit in (("Position", "error_m", "m"), ("Heading", "error_deg", "deg")):
        curve: list[plots.Series] = [("while driving", column(around, key), plots.ESTIMATE)]
        marks = _event_marks(around, context.start)
        source = plots.over_time(time, curve, f"error [{unit}]", marks=marks, cursor=cursor)
        yield Plot(f"{name} error around the moment", source, caption)


def _online_errors(context: ReportContext) -> AbsoluteError | None:
    """Errors of the poses that the filter reported scan by scan; None where they are unknown."""
    run, steps = context.run, context.run.steps
    if steps is None or run.truth is None or run.estimate is None:
        return None
    poses = np.column_stack([column(steps, name) for name in ("x", "y", "theta")])
    online = Trajectory(column(steps, "stamp"), poses)
    if not np.array_equal(online.stamps, run.estimate.stamps):
        return None
    return absolute_error(associate(online[context.rows], run.truth), "se2")


def _event_marks(steps: Columns, start: float) -> dict[str, tuple[NDArray[np.float64], str]]:
    """Times [s] of resamplings and loop closures, with their colours."""
    stamps = column(steps, "stamp") - start
    return {
        "resampled": (stamps[column(steps, "resampled") == 1.0], plots.ODOMETRY),
        "loop closed": (stamps[column(steps, "loop_closed") == 1.0], LOOPS),
    }


def filter_plots(context: ReportContext) -> Iterator[Plot]:
    """What the particle filter did at each update; nothing where no update is known."""
    steps = context.run.steps
    if steps is None or not updates(steps).any():
        return
    start, cursor = context.start, context.failure_time
    yield _sample_size_plot(steps, start, cursor)
    yield _ancestry_plot(steps, start, cursor)
    for plot in (_matching_plot(steps, start, cursor), _stages_plot(steps, start), _nees_plot(steps, start)):
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
    marks = {"resampled": (time[_at_updates(steps, "resampled") == 1.0], plots.ODOMETRY)}
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
    return Plot("Where the time goes", source, f"Time of all {particles:.0f} particles together.")


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
        "filter underestimates its error.",
    )
