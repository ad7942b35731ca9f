# SPDX-License-Identifier: MIT
"""Error against particle count."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eval.sweep.decision import median_over_last
from eval.sweep.figures.layout import panel_figure
from eval.sweep.figures.marks import (
    colour_of,
    count_axis,
    draw_state,
    draw_units,
    error_axis,
    error_limits,
    legend_colour,
    name_markers,
    shade_zone,
    shifted,
    states_of,
    write_answer,
)
from eval.sweep.panels import Panel, panels
from eval.sweep.results import SweepTable
from eval.sweep.statistics import bootstrap_interval, min_values
from eval.sweep.summary import SweepSummary


def accuracy(summary: SweepSummary) -> Figure:
    """Error against particle count: medians, intervals as bands, the zone within the margin of the largest count."""
    table, unit = summary.table, summary.unit
    shown = panels(summary)
    states = states_of(shown)
    base = table.lines.index(table.baseline)
    drawn = [_medians_and_ends(panel.error) for panel in shown]
    drawn += [median_over_last(panel.refined[base]) for panel in shown]
    limits = error_limits([unit.factor * values for values in drawn])

    def draw(ax: Axes, panel: Panel) -> None:
        write_answer(ax, panel.answer)
        _draw_zone(ax, panel.error[base, -1], unit.factor, table, limits[0])
        for k in range(len(table.lines)):
            x = shifted(table, k)
            _draw_medians(ax, x, unit.factor * panel.error[k], k, table)
            draw_units(ax, x, unit.factor * panel.error[k], k, limits, table)
            _draw_states(ax, x, unit.factor * median_over_last(panel.error[k]), panel.decisions[k].states, colour_of(k))
        refined = unit.factor * median_over_last(panel.refined[base])
        there = np.isfinite(refined)
        if there.any():
            (line_after,) = ax.plot(shifted(table, base)[there], refined[there], "s:", label="after the final pass")
            line_after.set(markersize=3.5, linewidth=1.0, markerfacecolor="white", color=_paler(colour_of(base)))
        own = f"{table.counts[-1]}, or passes its own test" if "good" in states else f"{table.counts[-1]} particles"
        name_markers(ax, table, states | {"good"}, own)
        count_axis(ax, table)
        error_axis(ax, limits)

    words = f"{table.measure.words} [{unit.name}]" if unit.name else table.measure.words
    entries = (
        3
        + len(states | {"good"})
        + len(table.lines)
        + summary.has_intervals
        + any((unit.factor * panel.error > limits[1]).any() for panel in shown)
    )
    return panel_figure(table, shown, draw, "particles", words, entries=entries)


def _draw_zone(ax: Axes, errors: NDArray[np.float64], factor: float, table: SweepTable, bottom: float) -> None:
    """Shade the errors that are at most the margin above that of the largest count, down to the end of the axis."""
    known = errors[np.isfinite(errors)]
    if not len(known):
        return
    median = float(np.median(known))
    shade_zone(ax, bottom, factor * (median + table.margin.of(median)), table)


def _draw_medians(ax: Axes, x: NDArray[np.float64], runs: NDArray[np.float64], k: int, table: SweepTable) -> None:
    """Medians over the units (counts, units), joined, with their 95 % intervals as a band; no band for a few runs.

    k: number of the line.
    """
    colour = colour_of(k)
    intervals = [bootstrap_interval(row, np.median) for row in runs]
    ax.plot(x, [interval.value for interval in intervals], "-", lw=1.4, color=colour, label=table.lines[k], zorder=3)
    ends = np.array([(i.low, i.high) if i.count >= min_values() else (np.nan, np.nan) for i in intervals])
    low, high = ends.T
    ax.fill_between(x, low, high, color=colour, alpha=0.18, lw=0)
    if np.isfinite(ends).any():
        ax.fill_between([], [], color=legend_colour(table), alpha=0.3, lw=0, label="95 % interval of the median")


def _draw_states(
    ax: Axes, x: NDArray[np.float64], medians: NDArray[np.float64], states: tuple[str, ...], colour: str
) -> None:
    """Mark each count: filled = not worse than the largest, hollow = undecided, cross = worse."""
    for place, value, state in zip(x, medians, (*states, "good"), strict=True):
        draw_state(ax, float(place), float(value), state, colour)


def _medians_and_ends(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Medians over the last axis and the ends of their intervals, flat."""
    rows = errors.reshape(-1, errors.shape[-1])
    intervals = [bootstrap_interval(row, np.median) for row in rows]
    return np.array([[i.low, i.value, i.high] for i in intervals]).ravel()


def _paler(colour: str) -> tuple[float, ...]:
    return tuple(0.45 + 0.55 * part for part in to_rgb(colour))
