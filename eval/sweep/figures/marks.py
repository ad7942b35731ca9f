# SPDX-License-Identifier: MIT
"""What the panels of a sweep's figures share: colours, markers of verdicts, dots of runs, axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from eval.report.comparison_plots import COLOURS
from eval.report.plots import BAD, GOOD, QUIET
from eval.sweep.answers import Answer
from eval.sweep.decision import State
from eval.sweep.panels import Panel
from eval.sweep.results import SweepTable
from eval.sweep.statistics import min_values

LINE_SHIFT = 0.05
"""Relative shift of the lines along the axis of counts, so that their bars do not hide each other."""
MAX_LINEAR_RATIO = 12.0
"""Errors are drawn on a linear axis if the largest is at most this many times the smallest, else on a logarithmic."""
FAIR = "#b35c00"
MARK_COLOURS = {"good": GOOD, "fair": FAIR, "bad": BAD}
"""Colours of answers."""
ZONE = "#d3f0d9"
"""Colour of the zone within the margin of the largest count."""
BESIDE = 0.05
"""Distance between runs beyond the axis, in steps of the axis of counts."""


def write_answer(ax: Axes, answer: Answer) -> None:
    """Write the answer above the right end of a panel."""
    ax.set_title(answer.panel, loc="right", color=MARK_COLOURS[answer.mark], fontsize=7.5, pad=4.0)


def shade_zone(ax: Axes, bottom: float, top: float, table: SweepTable) -> None:
    """Shade the zone within the margin of the largest count; a point in it may be open all the same."""
    ax.axhspan(bottom, top, color=ZONE, lw=0, zorder=0)
    ax.fill_between([], [], color=ZONE, lw=0, label=f"within the margin of {table.counts[-1]}")


def states_of(shown: Sequence[Panel]) -> frozenset[State]:
    """The verdicts on single counts that occur in any panel."""
    return frozenset(state for panel in shown for decision in panel.decisions for state in decision.states)


def name_markers(ax: Axes, table: SweepTable, states: frozenset[State], good: str = "") -> None:
    """Entries of the legend that say what the markers of these verdicts mean; good: text of the first of them."""
    look: dict[str, Any] = {"ls": "", "ms": 4.5, "mew": 1.2, "color": legend_colour(table)}
    words: dict[State, tuple[str, dict[str, Any]]] = {
        "good": (good or "passes its own test", {"marker": "o"}),
        "open": ("open", {"marker": "o", "mfc": "white"}),
        "worse": ("shown to be worse", {"marker": "x"}),
    }
    for state, (label, marker) in words.items():
        if state in states:
            ax.plot([], [], label=label, **marker, **look)


def draw_state(ax: Axes, x: float, y: float, state: str, colour: str) -> None:
    """Mark a verdict: filled = not worse than the largest, hollow = undecided, cross = worse."""
    look: dict[str, Any] = {"good": {"marker": "o", "mfc": colour}, "open": {"marker": "o", "mfc": "white"}}.get(
        state, {"marker": "x"}
    )
    ax.plot([x], [y], ms=4.5, mew=1.2, color=colour, zorder=4, clip_on=False, **look)


def legend_colour(table: SweepTable) -> str:
    """Colour of what looks alike for all lines: that of the line if there is one only."""
    return colour_of(0) if len(table.lines) == 1 else QUIET


def _unit_words(table: SweepTable) -> str:
    """What a dot stands for."""
    return "one run or drawn world" if table.family_names() else "one run"


def draw_units(
    ax: Axes, x: NDArray[np.float64], runs: NDArray[np.float64], k: int, limits: tuple[float, float], table: SweepTable
) -> None:
    """Draw every unit (counts, units) as a dot, faint where a band shows their spread; triangles beyond the axis, side
    by side.

    k: number of the line.
    """
    colour = colour_of(k)
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
    label, shade = _unit_words(table), legend_colour(table)
    ax.plot([], [], "o", ms=3.2, mew=0, alpha=0.6, color=shade, label=label)
    if not inside[np.isfinite(values)].all():
        ax.plot([], [], "^", ms=3.0, mew=0, alpha=0.6, color=shade, label="beyond the axis")


def error_limits(values: list[NDArray[np.float64]]) -> tuple[float, float]:
    """Ends of the axis of errors for all panels: a linear axis begins at 0, a logarithmic one spans at least 10."""
    flat = np.concatenate([v.ravel() for v in values])
    known = flat[np.isfinite(flat) & (flat > 0.0)]
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    return (0.0, 1.15 * high) if high <= MAX_LINEAR_RATIO * low else (0.8 * low, max(1.25 * high, 10.0 * low))


def error_axis(ax: Axes, limits: tuple[float, float]) -> None:
    """Axis with these ends, as `error_limits` gives them; logarithmic if it does not begin at 0."""
    if limits[0] > 0.0:
        ax.set_yscale("log")
        plain_numbers(ax.yaxis)
    ax.set_ylim(*limits)


def colour_of(k: int) -> str:
    """Colour of a line; k: its number."""
    return COLOURS[k % len(COLOURS)]


def shifted(table: SweepTable, k: int) -> NDArray[np.float64]:
    """Particle counts, shifted a little per line so that intervals stay visible, (counts,)."""
    moved = np.asarray(table.counts) * (1.0 + LINE_SHIFT) ** (k - 0.5 * (len(table.lines) - 1))
    return np.asarray(moved, dtype=np.float64)


def count_axis(ax: Axes, table: SweepTable) -> None:
    """Logarithmic axis with a tick at each tested count."""
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(FixedLocator(table.counts))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_locator(NullLocator())


def plain_numbers(axis: Axis) -> None:
    """Ticks of a logarithmic axis at 1, 2, 5, 10, …, without exponents."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
