# SPDX-License-Identifier: MIT
"""Whether the filter is as sure as it may be, and how many of its particles matter."""

from __future__ import annotations

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eval.report.plots import QUIET
from eval.sweep.decision import median_over_last
from eval.sweep.figures.layout import panel_figure
from eval.sweep.figures.marks import colour_of, count_axis, draw_units, shifted
from eval.sweep.panels import Panel, panels
from eval.sweep.results import CURVE_GRID
from eval.sweep.summary import SweepSummary


def coverage_of_95_percent(summary: SweepSummary) -> Figure:
    """Share of updates with the truth inside the filter's 95 % ellipsoid, against particle count."""
    table = summary.table

    def draw(ax: Axes, panel: Panel) -> None:
        ax.axhline(95.0, color=QUIET, lw=1.0, ls=(0, (4, 2)), label="expected: 95 %")
        for k, line in enumerate(table.lines):
            x = shifted(table, k)
            draw_units(ax, x, 100.0 * panel.inside[k], k, (0.0, 100.0), table)
            ax.plot(
                x, 100.0 * median_over_last(panel.inside[k]), "o-", ms=3.5, color=colour_of(k), label=line, zorder=3
            )
        count_axis(ax, table)
        ax.set_ylim(-4.0, 104.0)

    return panel_figure(table, panels(summary), draw, "particles", "truth inside [% of updates]")


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

    return panel_figure(table, panels(summary), draw, "share of the run [%]", label)
