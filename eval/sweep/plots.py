# SPDX-License-Identifier: MIT
"""Figures of a sweep, one panel per world; a line of the sweep has the same colour in all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from eval.report.comparison import COLOURS
from eval.report.plots import QUIET, STYLE
from eval.sweep.results import CURVE_GRID, SweepTable
from eval.sweep.summary import Group, SweepSummary

PANEL = (3.7, 2.6)
"""Size of a panel [inch]."""
COLUMNS = 3
LINE_SHIFT = 0.05
"""Relative shift of the lines along the axis of counts, so that their bars do not hide each other."""


def accuracy(summary: SweepSummary) -> Figure:
    """Error against particle count: medians with their interval, every run a faint dot."""
    table, unit = summary.table, Unit.of(summary.table.measure)

    def draw(ax: Axes, p: int) -> None:
        for k, line in enumerate(table.lines):
            x = _shifted(table, k)
            groups = _groups(summary, p, k)
            runs = unit.factor * table.error[p, k]
            _dots(ax, x, runs, k)
            _line(ax, x, [unit.factor * g.median.value for g in groups], line, k)
            low, high = ([unit.factor * getattr(g.median, end) for g in groups] for end in ("low", "high"))
            ax.fill_between(x, low, high, color=_colour(k), alpha=0.15, lw=0)
        _count_axis(ax, table)
        _log_values(ax)

    return _panels(table, draw, "particles", f"{unit.words}")


def failures(summary: SweepSummary) -> Figure:
    """Failure rate against particle count, with Wilson intervals."""
    table = summary.table

    def draw(ax: Axes, p: int) -> None:
        for k, line in enumerate(table.lines):
            groups = [g for g in _groups(summary, p, k) if g.runs]
            x = _shifted(table, k)[[table.counts.index(g.count) for g in groups]]
            rate = np.array([100.0 * g.failures / g.runs for g in groups])
            ends = 100.0 * np.array([g.failure_interval for g in groups]).reshape(-1, 2).T
            bars = np.maximum(np.abs(ends - rate), 0.0)
            ax.errorbar(x, rate, yerr=bars, fmt="o-", ms=4, lw=1.2, elinewidth=0.9, color=_colour(k), label=line)
        _count_axis(ax, table)
        ax.set_ylim(-4.0, 104.0)

    return _panels(table, draw, "particles", "runs that failed [%]")


def cost_against_accuracy(summary: SweepSummary) -> Figure:
    """Median error against time per update; a black line joins the Pareto-optimal groups."""
    table, unit = summary.table, Unit.of(summary.table.measure)

    def draw(ax: Axes, p: int) -> None:
        points = []
        for k, line in enumerate(table.lines):
            groups = _groups(summary, p, k)
            cost, error = np.array([g.cost for g in groups]), unit.factor * np.array([g.median.value for g in groups])
            _line(ax, cost, error, line, k)
            points += [(c, e, g.count) for c, e, g in zip(cost, error, groups, strict=True) if np.isfinite(c + e)]
        front = pareto_front(np.array([point[:2] for point in points]).reshape(-1, 2))
        best = [points[row] for row in front]
        ax.plot([c for c, _, _ in best], [e for _, e, _ in best], color="black", lw=1.0, label="front", zorder=4)
        for c, e, count in best:
            ax.annotate(str(count), (c, e), xytext=(3, -9), textcoords="offset points", fontsize=8)
        ax.set_xscale("log")
        _plain_numbers(ax.xaxis)
        _log_values(ax)

    return _panels(table, draw, "time per update [ms]", f"{unit.words}, median")


def pareto_front(points: NDArray[np.float64]) -> list[int]:
    """Rows of the Pareto-optimal points among (n, 2), both columns to be minimised, sorted by the first column."""
    front: list[int] = []
    for row in np.lexsort((points[:, 1], points[:, 0])):
        if not front or points[row, 1] < points[front[-1], 1]:
            front.append(int(row))
    return front


def coverage_of_95_percent(summary: SweepSummary) -> Figure:
    """Share of updates with the truth inside the filter's 95 % ellipsoid, against particle count."""
    table = summary.table

    def draw(ax: Axes, p: int) -> None:
        ax.axhline(95.0, color=QUIET, lw=1.0, ls=(0, (4, 2)), label="expected: 95 %")
        inside = 100.0 * table.cube("filter.consistency.inside_share")
        for k, line in enumerate(table.lines):
            x = _shifted(table, k)
            runs = inside[p, k]
            _dots(ax, x, runs, k)
            _line(ax, x, [100.0 * g.inside_share for g in _groups(summary, p, k)], line, k)
        _count_axis(ax, table)
        ax.set_ylim(-4.0, 104.0)

    return _panels(table, draw, "particles", "truth inside [% of updates]")


def health(summary: SweepSummary, curve: str, label: str) -> Figure:
    """`ess` or `unique_ancestors` of the baseline along the run, median over seeds, one shade per particle count."""
    table = summary.table
    base = table.lines.index(table.baseline)
    counts = [c for c, count in enumerate(table.counts) if count > 1]  # one particle is always 100 %

    def draw(ax: Axes, p: int) -> None:
        for step, c in enumerate(counts):
            values = 100.0 * _median_curve(table.curves[curve][p, base, c])
            shade = colormaps["viridis"](0.85 * step / max(len(counts) - 1, 1))
            ax.plot(100.0 * CURVE_GRID, values, color=shade, lw=1.3, label=f"{table.counts[c]} particles")
        ax.set_ylim(-2.0, 104.0)

    return _panels(table, draw, "share of the run [%]", label)


class Unit:
    """How a measure is shown: metres as centimetres, everything else unchanged."""

    def __init__(self, words: str, factor: float, name: str) -> None:
        self.words, self.factor, self.name = words, factor, name

    @classmethod
    def of(cls, measure: str) -> Unit:
        """The unit by the key of the measure, whose suffix names it."""
        names = {"trajectory.ate_rmse_m": "trajectory error", "relations.trans_mean_m": "relation error"}
        if measure.endswith("_m"):
            return cls(f"{names.get(measure, measure.removesuffix('_m'))} [cm]", 100.0, "cm")
        if measure.endswith("_deg"):
            return cls(f"{names.get(measure, measure.removesuffix('_deg'))} [deg]", 1.0, "deg")
        return cls(measure, 1.0, "")


@contextmanager
def style() -> Iterator[None]:
    """Style of all figures; needed while drawing and while writing to a file."""
    with rc_context(STYLE):
        yield


def _panels(table: SweepTable, draw: Callable[[Axes, int], None], x: str, y: str) -> Figure:
    """One panel per world, with shared axis labels and one legend."""
    columns = min(COLUMNS, len(table.places))
    rows = math.ceil(len(table.places) / columns)
    with style():
        figure = Figure(figsize=(PANEL[0] * columns, PANEL[1] * rows + 0.35))
        grid = figure.subplots(rows, columns, squeeze=False)
        for p, ax in enumerate(grid.flat):
            if p >= len(table.places):
                ax.set_visible(False)
                continue
            draw(ax, p)
            ax.set_title(table.places[p], fontsize=10)
            if p % columns == 0:
                ax.set_ylabel(y)
            if p + columns >= len(table.places):
                ax.set_xlabel(x)
        handles: dict[str, Any] = {}
        for ax in grid.flat[: len(table.places)]:
            handles |= {label: handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        figure.legend(list(handles.values()), list(handles), loc="outside upper left", ncols=min(len(handles), 7))
    return figure


def _groups(summary: SweepSummary, p: int, k: int) -> list[Group]:
    table = summary.table
    return [summary.group(table.places[p], table.lines[k], count) for count in table.counts]


def _line(ax: Axes, x: Any, values: Any, name: str, k: int) -> None:
    ax.plot(x, values, "o-", ms=4, lw=1.5, color=_colour(k), label=name, zorder=3)


def _dots(ax: Axes, x: NDArray[np.float64], runs: NDArray[np.float64], k: int) -> None:
    """Draw every run (counts, seeds) as a faint dot."""
    ax.plot(np.repeat(x, runs.shape[1]), runs.ravel(), "o", ms=2.6, mew=0, alpha=0.35, color=_colour(k))


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _shifted(table: SweepTable, k: int) -> NDArray[np.float64]:
    """Particle counts, shifted a little per line so that intervals stay visible, (counts,)."""
    moved = np.asarray(table.counts) * (1.0 + LINE_SHIFT) ** (k - 0.5 * (len(table.lines) - 1))
    return np.asarray(moved, dtype=np.float64)


def _count_axis(ax: Axes, table: SweepTable) -> None:
    """Logarithmic axis with a tick at each tested count."""
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(FixedLocator(table.counts))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_locator(NullLocator())


def _log_values(ax: Axes) -> None:
    """Logarithmic axis of errors."""
    ax.set_yscale("log")
    _plain_numbers(ax.yaxis)


def _plain_numbers(axis: Axis) -> None:
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _median_curve(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median of the finite values over the first axis; NaN where there are none."""
    known = np.isfinite(values).any(axis=0)
    middle = np.full(values.shape[1], np.nan)
    middle[known] = np.nanmedian(values[:, known], axis=0)
    return middle
