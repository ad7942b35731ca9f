# SPDX-License-Identifier: MIT
"""Paired differences to the largest count, which decide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eval.report.plots import GOOD, QUIET
from eval.sweep.figures.layout import panel_figure
from eval.sweep.figures.marks import (
    colour_of,
    draw_state,
    draw_units,
    legend_colour,
    name_markers,
    shade_zone,
    states_of,
    write_answer,
)
from eval.sweep.panels import Panel, panels
from eval.sweep.statistics import Interval, min_values
from eval.sweep.summary import SweepSummary

MAX_MARGINS = 5.0
"""The axis of differences spans at most so many margins to each side."""


def differences(summary: SweepSummary) -> Figure:
    """Paired differences to the largest count with the intervals that decide, and the margin."""
    table, unit = summary.table, summary.unit
    shown = panels(summary)
    states = states_of(shown)
    limits = _difference_limits(shown, unit.factor)
    moved = [[number + 0.16 * (k - 0.5 * (len(table.lines) - 1)) for k in range(len(table.lines))]
             for number in range(len(table.counts) - 1)]  # fmt: skip

    def draw(ax: Axes, panel: Panel) -> None:
        write_answer(ax, panel.answer)
        ax.axhline(0.0, color=QUIET, lw=0.8, zorder=1)
        margin = unit.factor * panel.decisions[table.lines.index(table.baseline)].limit
        if math.isfinite(margin):
            shade_zone(ax, limits[0], margin, table)
            ax.axhline(margin, color=GOOD, lw=1.4, ls=(0, (4, 2)), zorder=2, label="margin")
        for (k, decision), c in product(enumerate(panel.decisions), range(len(table.counts) - 1)):
            pairs = unit.factor * (panel.error[k, c] - panel.error[k, -1])
            draw_units(ax, np.array([moved[c][k] + 0.06]), pairs[None], k, limits, table)
            _draw_interval(
                ax, moved[c][k], decision.differences[c], decision.states[c], unit.factor, limits, colour_of(k)
            )
        if len(table.lines) > 1:
            for k, line in enumerate(table.lines):
                ax.plot([], [], "-", lw=1.6, color=colour_of(k), label=line)
        if summary.has_intervals:
            deciding = f"{100.0 * table.level:.3g} % interval, which decides"
            ax.plot([], [], "-", lw=1.6, color=legend_colour(table), label=deciding)
        name_markers(ax, table, states)
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
    return panel_figure(table, shown, draw, "particles", words, entries=entries)


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
    least = min(ends, default=0.0) - max(margins)  # a few runs that did far better would squeeze the intervals
    ends += [max(float(np.nanmin(values)), least) for values in runs if np.isfinite(values).any()]
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
    draw_state(ax, x, min(value, limits[1]), state, colour)
