# SPDX-License-Identifier: MIT
"""Figures of a sweep: one panel per world or kind of building, one axis for all panels, a colour per line.

They are as wide as one or two columns of a journal, and their fonts do not depend on the number of panels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from eval.report.comparison_plots import COLOURS
from eval.report.plots import BAD, GOOD, QUIET, STYLE
from eval.sweep.answers import Answer
from eval.sweep.decision import State, median_over_last
from eval.sweep.panels import Panel, panels
from eval.sweep.results import CURVE_GRID, SweepTable
from eval.sweep.statistics import Interval, bootstrap_interval, min_values, wilson_interval
from eval.sweep.summary import SweepSummary

WIDTHS = (3.5, 5.3, 7.16)
"""Width of a figure with 1, 2, 3 panels in a row [inch]; the first and the last are one and two columns of a page."""
PANEL_HEIGHT = 2.0
"""Height of a row of panels [inch]."""
LINE_SHIFT = 0.05
"""Relative shift of the lines along the axis of counts, so that their bars do not hide each other."""
MAX_LINEAR_RATIO = 12.0
"""Errors are drawn on a linear axis if the largest is at most this many times the smallest, else on a logarithmic."""
FAIR = "#b35c00"
MARK_COLOURS = {"good": GOOD, "fair": FAIR, "bad": BAD}
"""Colours of answers."""
ZONE = "#d3f0d9"
"""Colour of the zone within the margin of the largest count."""
MAX_MARGINS = 5.0
"""The axis of differences spans at most so many margins to each side."""
BESIDE = 0.05
"""Distance between runs beyond the axis, in steps of the axis of counts."""
LEGEND_ROW = 0.17
"""Height of a row of the legend [inch]."""
_BETWEEN_ROWS, _BETWEEN_COLUMNS, _BELOW, _RIGHT = 0.34, 0.14, 0.42, 0.14
"""Margins between and around panels [inch]."""
Draw = Callable[[Axes, Panel], None]


def accuracy(summary: SweepSummary) -> Figure:
    """Error against particle count: medians, intervals as bands, the zone within the margin of the largest count."""
    table, unit = summary.table, summary.unit
    shown = panels(summary)
    states = _states_of(shown)
    base = table.lines.index(table.baseline)
    drawn = [_medians_and_ends(panel.error) for panel in shown]
    drawn += [median_over_last(panel.refined[base]) for panel in shown]
    limits = _error_limits([unit.factor * values for values in drawn])

    def draw(ax: Axes, panel: Panel) -> None:
        _write_answer(ax, panel.answer)
        _draw_zone(ax, panel.error[base, -1], unit.factor, table, limits[0])
        for k in range(len(table.lines)):
            x = _shifted(table, k)
            _draw_medians(ax, x, unit.factor * panel.error[k], k, table)
            _draw_units(ax, x, unit.factor * panel.error[k], k, limits, table)
            _draw_states(ax, x, unit.factor * median_over_last(panel.error[k]), panel.decisions[k].states, _colour(k))
        refined = unit.factor * median_over_last(panel.refined[base])
        there = np.isfinite(refined)
        if there.any():
            (line_after,) = ax.plot(_shifted(table, base)[there], refined[there], "s:", label="after the final pass")
            line_after.set(markersize=3.5, linewidth=1.0, markerfacecolor="white", color=_paler(_colour(base)))
        own = f"{table.counts[-1]}, or passes its own test" if "good" in states else f"{table.counts[-1]} particles"
        _name_markers(ax, table, states | {"good"}, own)
        _count_axis(ax, table)
        _error_axis(ax, limits)

    words = f"{table.measure.words} [{unit.name}]" if unit.name else table.measure.words
    entries = (
        3
        + len(states | {"good"})
        + len(table.lines)
        + summary.has_intervals
        + any((unit.factor * panel.error > limits[1]).any() for panel in shown)
    )
    return _figure(table, shown, draw, "particles", words, entries=entries)


def differences(summary: SweepSummary) -> Figure:
    """Paired differences to the largest count with the intervals that decide, and the margin."""
    table, unit = summary.table, summary.unit
    shown = panels(summary)
    states = _states_of(shown)
    limits = _difference_limits(shown, unit.factor)
    moved = [[number + 0.16 * (k - 0.5 * (len(table.lines) - 1)) for k in range(len(table.lines))]
             for number in range(len(table.counts) - 1)]  # fmt: skip

    def draw(ax: Axes, panel: Panel) -> None:
        _write_answer(ax, panel.answer)
        ax.axhline(0.0, color=QUIET, lw=0.8, zorder=1)
        margin = unit.factor * panel.decisions[table.lines.index(table.baseline)].limit
        if math.isfinite(margin):
            _shade(ax, limits[0], margin, table)
            ax.axhline(margin, color=GOOD, lw=1.4, ls=(0, (4, 2)), zorder=2, label="margin")
        for (k, decision), c in product(enumerate(panel.decisions), range(len(table.counts) - 1)):
            pairs = unit.factor * (panel.error[k, c] - panel.error[k, -1])
            _draw_units(ax, np.array([moved[c][k] + 0.06]), pairs[None], k, limits, table)
            _draw_interval(
                ax, moved[c][k], decision.differences[c], decision.states[c], unit.factor, limits, _colour(k)
            )
        if len(table.lines) > 1:
            for k, line in enumerate(table.lines):
                ax.plot([], [], "-", lw=1.6, color=_colour(k), label=line)
        if summary.has_intervals:
            deciding = f"{100.0 * table.level:.3g} % interval, which decides"
            ax.plot([], [], "-", lw=1.6, color=_legend_colour(table), label=deciding)
        _name_markers(ax, table, states)
        ax.set_xlim(-0.5, len(table.counts) - 1.5)
        ax.set_xticks(range(len(table.counts) - 1), [str(count) for count in table.counts[:-1]])
        ax.set_ylim(*limits)

    words = f"error above that with {table.counts[-1]}" + (f" [{unit.name}]" if unit.name else "")
    lines = len(table.lines) if len(table.lines) > 1 else 0
    factor, rows = unit.factor, slice(None, -1)
    entries = (
        3
        + len(states)
        + lines
        + summary.has_intervals
        + any(_is_beyond(factor * (panel.error[:, rows] - panel.error[:, -1:]), limits) for panel in shown)
    )
    return _figure(table, shown, draw, "particles", words, entries=entries)


def _difference_limits(shown: Sequence[Panel], factor: float) -> tuple[float, float]:
    """Ends of the axis of differences for all panels: all intervals, and the runs that did better, but at most
    `MAX_MARGINS` margins."""
    decisions = [decision for panel in shown for decision in panel.decisions]
    margins = [factor * decision.limit for decision in decisions if math.isfinite(decision.limit)]
    if not margins:
        return -1.0, 1.0
    intervals = [interval for decision in decisions for interval in decision.differences]
    ends = [factor * end for i in intervals for end in (i.low, i.value, i.high) if math.isfinite(end)]
    runs = [factor * (panel.error[:, :-1] - panel.error[:, -1:]) for panel in shown]
    ends += [float(np.nanmin(values)) for values in runs if np.isfinite(values).any()]
    most = MAX_MARGINS * max(margins)
    low, high = min(ends, default=0.0), max(ends, default=0.0)
    return 1.15 * max(min(low, -max(margins)), -most), 1.15 * min(max(high, 1.5 * max(margins)), most)


def _is_beyond(values: NDArray[np.float64], limits: tuple[float, float]) -> bool:
    return bool(((values > limits[1]) | (values < limits[0])).any())


def _draw_interval(
    ax: Axes, x: float, difference: Interval, state: str, factor: float, limits: tuple[float, float], colour: str
) -> None:
    """A difference with its interval, marked as in the figure of accuracy; no interval for a few runs.

    What lies beyond the axis ends at its edge, with an arrow head.
    """
    value, low, high = (factor * end for end in (difference.value, difference.low, difference.high))
    if not math.isfinite(value):
        return
    if difference.count >= min_values() and math.isfinite(low + high):
        ax.plot([x, x], np.clip([low, high], *limits), "-", lw=1.6, color=colour, zorder=3, solid_capstyle="butt")
        for is_cut, end, marker in ((high > limits[1], limits[1], "^"), (low < limits[0], limits[0], "v")):
            if is_cut:
                ax.plot([x], [end], marker, ms=5.0, mew=0, color=colour, zorder=3, clip_on=False)
    _draw_state(ax, x, min(value, limits[1]), state, colour)


def failures(summary: SweepSummary) -> Figure:
    """Failed runs of all runs for each filter and count, with the Wilson interval of the rate in pale letters."""
    table = summary.table

    def draw(ax: Axes, panel: Panel) -> None:
        ax.set_xlim(-0.6, len(table.counts) - 0.4)
        for k, c in np.ndindex(*panel.runs.shape):
            failed, runs = int(panel.failed[k, c]), int(panel.runs[k, c])
            if not runs:
                continue
            rate = failed / runs
            ax.add_patch(Rectangle((c - 0.48, k - 0.46), 0.96, 0.92, fc=(*to_rgb(BAD), 0.75 * rate), ec="#e9ecef"))
            low, high = (round(100.0 * end) for end in wilson_interval(failed, runs))
            _write_into_cell(ax, c, k - 0.12, f"{failed}/{runs}", size=7.0, smallest=4.0, color="black")
            _write_into_cell(ax, c, k + 0.24, f"{low}–{high} %", size=4.8, smallest=4.0, color="#495057")
        ax.set_ylim(len(table.lines) - 0.4, -0.6)
        ax.set_xticks(range(len(table.counts)), [str(count) for count in table.counts])
        ax.set_yticks(
            range(len(table.lines)) if len(table.lines) > 1 else [], table.lines if len(table.lines) > 1 else []
        )
        ax.grid(visible=False)

    left = 0.25 + 0.065 * max(map(len, table.lines))
    height = 0.1 + 0.4 * len(table.lines)
    return _figure(table, panels(summary), draw, "particles", "", height=height, left=left, entries=0)


def _write_into_cell(ax: Axes, x: float, y: float, text: str, *, size: float, smallest: float, color: str) -> None:
    """Write a text as large as its cell of width 1 allows; not at all if it would be too small to read [pt]."""
    width = 72.0 * ax.get_figure().get_figwidth() * ax.get_position().width / (ax.get_xlim()[1] - ax.get_xlim()[0])  # type: ignore[union-attr]
    fitting = min(size, width / (0.62 * len(text)))
    if fitting >= smallest:
        ax.text(x, y, text, ha="center", va="center", fontsize=fitting, color=color)


def cost_against_accuracy(summary: SweepSummary) -> Figure:
    """Median error against time per update; each point has its count, a line joins the Pareto-optimal ones."""
    table, unit = summary.table, summary.unit
    shown = panels(summary)
    limits = _error_limits([unit.factor * median_over_last(panel.error) for panel in shown])
    costs = np.concatenate([panel.cost.ravel() for panel in shown])
    costs = costs[np.isfinite(costs) & (costs > 0.0)]

    def draw(ax: Axes, panel: Panel) -> None:
        points = []
        for k, line in enumerate(table.lines):
            error = unit.factor * median_over_last(panel.error[k])
            ax.plot(panel.cost[k], error, "o-", ms=3.5, lw=1.0, color=_colour(k), label=line, zorder=3)
            for c, (x, y) in enumerate(zip(panel.cost[k], error, strict=True)):
                if np.isfinite(x + y):
                    points.append((float(x), float(y)))
                    is_valley = 0 < c < len(error) - 1 and bool(y < min(error[c - 1], error[c + 1]))
                    ax.annotate(
                        str(table.counts[c]), (x, y), xytext=(0, -4 if is_valley else 4), textcoords="offset points",
                        fontsize=6.5, ha="center", va="top" if is_valley else "bottom", color=_colour(k), zorder=5,
                        path_effects=[withStroke(linewidth=2.0, foreground="white")],
                    )  # fmt: skip
        best = [points[row] for row in pareto_front(np.array(points).reshape(-1, 2))]
        ax.plot(
            [x for x, _ in best], [y for _, y in best], color="black", lw=2.4, alpha=0.25, label="front", zorder=2,
            drawstyle="steps-post", solid_capstyle="round", marker="o", ms=8.0, mec="none",
        )  # fmt: skip
        ax.set_xscale("log")
        if len(costs):
            ax.set_xlim(0.7 * costs.min(), 1.5 * costs.max())
        _plain_numbers(ax.xaxis)
        _error_axis(ax, limits)

    words = f"{table.measure.words} [{unit.name}]" if unit.name else table.measure.words
    return _figure(table, shown, draw, "time per update [ms]", words)


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

    def draw(ax: Axes, panel: Panel) -> None:
        ax.axhline(95.0, color=QUIET, lw=1.0, ls=(0, (4, 2)), label="expected: 95 %")
        for k, line in enumerate(table.lines):
            x = _shifted(table, k)
            _draw_units(ax, x, 100.0 * panel.inside[k], k, (0.0, 100.0), table)
            ax.plot(x, 100.0 * median_over_last(panel.inside[k]), "o-", ms=3.5, color=_colour(k), label=line, zorder=3)
        _count_axis(ax, table)
        ax.set_ylim(-4.0, 104.0)

    return _figure(table, panels(summary), draw, "particles", "truth inside [% of updates]")


def health(summary: SweepSummary, curve: str, label: str) -> Figure:
    """`ess` or `unique_ancestors` of the baseline along the run, median over runs, one shade per particle count."""
    table = summary.table
    base = table.lines.index(table.baseline)
    counts = [c for c, count in enumerate(table.counts) if count > 1]  # one particle is always 100 %

    def draw(ax: Axes, panel: Panel) -> None:
        for step, c in enumerate(counts):
            runs = table.curves[curve][list(panel.rows), base, c].reshape(-1, len(CURVE_GRID))
            shade = colormaps["viridis"](0.85 * step / max(len(counts) - 1, 1))
            values = 100.0 * median_over_last(runs.T)
            ax.plot(100.0 * CURVE_GRID, values, color=shade, lw=1.2, label=f"{table.counts[c]} particles")
        ax.set_ylim(-2.0, 104.0)

    return _figure(table, panels(summary), draw, "share of the run [%]", label)


@contextmanager
def style() -> Iterator[None]:
    """Style of all figures; needed while drawing and while writing to a file."""
    small = {
        "figure.constrained_layout.use": False,
        "font.size": 8.0,
        "axes.titlesize": 8.5,
        "legend.fontsize": 7.5,
        "lines.linewidth": 1.2,
    }
    with rc_context(STYLE | small):
        yield


def _figure(
    table: SweepTable,
    shown: Sequence[Panel],
    draw: Draw,
    x: str,
    y: str,
    *,
    height: float = PANEL_HEIGHT,
    left: float = 0.55,
    entries: int | None = None,
) -> Figure:
    """Panels with shared axes and axis labels, each with its name as title, and one legend.

    height of a panel and left margin [inch]; entries of the legend at most (default: those of two rows). All margins
    are lengths, so that panels and letters keep their size.
    """
    columns = min(len(WIDTHS), len(shown))
    rows = math.ceil(len(shown) / columns)
    width = WIDTHS[columns - 1]
    per_row = columns + 1 if entries else 2 * columns
    legend_rows = math.ceil(entries / per_row) if entries is not None else (2 if columns == 1 else 1)
    top = 0.24 + (0.06 + LEGEND_ROW * legend_rows) * (legend_rows > 0)
    total = top + rows * height + (rows - 1) * _BETWEEN_ROWS + _BELOW
    with style():
        figure = Figure(figsize=(width, total))
        panel_width = (width - left - _RIGHT - (columns - 1) * _BETWEEN_COLUMNS) / columns
        grid = figure.subplots(
            rows,
            columns,
            squeeze=False,
            sharex=True,
            sharey=True,
            gridspec_kw={
                "left": left / width,
                "right": 1.0 - _RIGHT / width,
                "bottom": _BELOW / total,
                "top": 1.0 - top / total,
                "wspace": _BETWEEN_COLUMNS / panel_width,
                "hspace": _BETWEEN_ROWS / height,
            },
        )
        for number, ax in enumerate(grid.flat):
            if number >= len(shown):
                ax.set_visible(False)
                continue
            draw(ax, shown[number])
            is_lowest = number + columns >= len(shown)
            _label(ax, shown[number], x if is_lowest else "", y if number % columns == 0 else "")
            ax.tick_params(labelbottom=is_lowest)
        if legend_rows:
            _draw_legend(figure, grid.flat[: len(shown)], len(table.lines), per_row)
    return figure


def _label(ax: Axes, panel: Panel, x: str, y: str) -> None:
    """Title a panel with its name and label its axes."""
    ax.set_title(panel.answer.place, loc="left", fontweight="bold", pad=4.0)
    ax.set_xlabel(x)
    ax.set_ylabel(y)


def _write_answer(ax: Axes, answer: Answer) -> None:
    """Write the answer above the right end of a panel."""
    ax.set_title(answer.panel, loc="right", color=MARK_COLOURS[answer.mark], fontsize=7.5, pad=4.0)


def _draw_legend(figure: Figure, axes: Any, lines: int, per_row: int) -> None:
    handles: dict[str, Any] = {}
    for ax in axes:
        handles |= {label: handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    if lines == 1:
        handles = {"filter" if label == "default" else label: handle for label, handle in handles.items()}
    figure.legend(
        list(handles.values()),
        list(handles),
        loc="upper left",
        ncols=min(len(handles), per_row),
        borderaxespad=0.1,
        columnspacing=1.2,
        handlelength=1.7,
    )


def _draw_zone(ax: Axes, errors: NDArray[np.float64], factor: float, table: SweepTable, bottom: float) -> None:
    """Shade the errors that are at most the margin above that of the largest count, down to the end of the axis."""
    known = errors[np.isfinite(errors)]
    if not len(known):
        return
    median = float(np.median(known))
    _shade(ax, bottom, factor * (median + table.margin.of(median)), table)


def _shade(ax: Axes, bottom: float, top: float, table: SweepTable) -> None:
    """Shade the zone within the margin of the largest count; a point in it may be open all the same."""
    ax.axhspan(bottom, top, color=ZONE, lw=0, zorder=0)
    ax.fill_between([], [], color=ZONE, lw=0, label=f"within the margin of {table.counts[-1]}")


def _draw_medians(ax: Axes, x: NDArray[np.float64], runs: NDArray[np.float64], k: int, table: SweepTable) -> None:
    """Medians over the units (counts, units), joined, with their 95 % intervals as a band; no band for a few runs.

    k: number of the line.
    """
    colour = _colour(k)
    intervals = [bootstrap_interval(row, np.median) for row in runs]
    ax.plot(x, [interval.value for interval in intervals], "-", lw=1.4, color=colour, label=table.lines[k], zorder=3)
    ends = np.array([(i.low, i.high) if i.count >= min_values() else (np.nan, np.nan) for i in intervals])
    low, high = ends.T
    ax.fill_between(x, low, high, color=colour, alpha=0.18, lw=0)
    if np.isfinite(ends).any():
        ax.fill_between([], [], color=_legend_colour(table), alpha=0.3, lw=0, label="95 % interval of the median")


def _states_of(shown: Sequence[Panel]) -> frozenset[State]:
    """The verdicts on single counts that occur in any panel."""
    return frozenset(state for panel in shown for decision in panel.decisions for state in decision.states)


def _name_markers(ax: Axes, table: SweepTable, states: frozenset[State], good: str = "") -> None:
    """Entries of the legend that say what the markers of these verdicts mean; good: text of the first of them."""
    look: dict[str, Any] = {"ls": "", "ms": 4.5, "mew": 1.2, "color": _legend_colour(table)}
    words: dict[State, tuple[str, dict[str, Any]]] = {
        "good": (good or "passes its own test", {"marker": "o"}),
        "open": ("open", {"marker": "o", "mfc": "white"}),
        "worse": ("shown to be worse", {"marker": "x"}),
    }
    for state, (label, marker) in words.items():
        if state in states:
            ax.plot([], [], label=label, **marker, **look)


def _draw_states(
    ax: Axes, x: NDArray[np.float64], medians: NDArray[np.float64], states: tuple[str, ...], colour: str
) -> None:
    """Mark each count: filled = not worse than the largest, hollow = undecided, cross = worse."""
    for place, value, state in zip(x, medians, (*states, "good"), strict=True):
        _draw_state(ax, float(place), float(value), state, colour)


def _draw_state(ax: Axes, x: float, y: float, state: str, colour: str) -> None:
    look: dict[str, Any] = {"good": {"marker": "o", "mfc": colour}, "open": {"marker": "o", "mfc": "white"}}.get(
        state, {"marker": "x"}
    )
    ax.plot([x], [y], ms=4.5, mew=1.2, color=colour, zorder=4, clip_on=False, **look)


def _legend_colour(table: SweepTable) -> str:
    """Colour of what looks alike for all lines: that of the line if there is one only."""
    return _colour(0) if len(table.lines) == 1 else QUIET


def _unit_words(table: SweepTable) -> str:
    """What a dot stands for."""
    return "one run or drawn world" if table.family_names() else "one run"


def _draw_units(
    ax: Axes, x: NDArray[np.float64], runs: NDArray[np.float64], k: int, limits: tuple[float, float], table: SweepTable
) -> None:
    """Draw every unit (counts, units) as a dot, faint where a band shows their spread; triangles beyond the axis, side
    by side.

    k: number of the line.
    """
    colour = _colour(k)
    places, values = np.repeat(x, runs.shape[1]), runs.ravel()
    above, below = values > limits[1], values < limits[0]
    inside = ~(above | below)
    are_few = np.isfinite(runs).sum(axis=1).max(initial=0) < min_values()
    ax.plot(
        places[inside],
        values[inside],
        "o",
        ms=3.2 if are_few else 2.2,
        mew=0,
        alpha=0.6 if are_few else 0.35,
        color=colour,
    )
    for beyond, end, marker in ((above, limits[1], "^"), (below, limits[0], "v")):
        for place in np.unique(places[beyond]):
            count = int((places[beyond] == place).sum())
            beside = place + BESIDE * np.arange(count)
            ax.plot(beside, np.full(count, end), marker, ms=3.0, mew=0, alpha=0.6, color=colour, clip_on=False)
    label, shade = _unit_words(table), _legend_colour(table)
    ax.plot([], [], "o", ms=3.2, mew=0, alpha=0.6, color=shade, label=label)
    if not inside[np.isfinite(values)].all():
        ax.plot([], [], "^", ms=3.0, mew=0, alpha=0.6, color=shade, label="beyond the axis")


def _medians_and_ends(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Medians over the last axis and the ends of their intervals, flat."""
    rows = errors.reshape(-1, errors.shape[-1])
    intervals = [bootstrap_interval(row, np.median) for row in rows]
    return np.array([[i.low, i.value, i.high] for i in intervals]).ravel()


def _error_limits(values: list[NDArray[np.float64]]) -> tuple[float, float]:
    """Ends of the axis of errors for all panels: a linear axis begins at 0, a logarithmic one spans at least 10."""
    flat = np.concatenate([v.ravel() for v in values])
    known = flat[np.isfinite(flat) & (flat > 0.0)]
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    return (0.0, 1.15 * high) if high <= MAX_LINEAR_RATIO * low else (0.8 * low, max(1.25 * high, 10.0 * low))


def _error_axis(ax: Axes, limits: tuple[float, float]) -> None:
    if limits[0] > 0.0:
        ax.set_yscale("log")
        _plain_numbers(ax.yaxis)
    ax.set_ylim(*limits)


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _paler(colour: str) -> tuple[float, ...]:
    return tuple(0.45 + 0.55 * part for part in to_rgb(colour))


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


def _plain_numbers(axis: Axis) -> None:
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
