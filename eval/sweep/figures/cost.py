# SPDX-License-Identifier: MIT
"""Error against the time that an update takes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from eval.sweep.decision import median_over_last
from eval.sweep.figures.layout import panel_figure
from eval.sweep.figures.marks import colour_of, error_axis, error_limits, plain_numbers
from eval.sweep.panels import Panel, panels
from eval.sweep.summary import SweepSummary


def cost_against_accuracy(summary: SweepSummary) -> Figure:
    """Median error against time per update; each point has its count, a line joins the Pareto-optimal ones."""
    table, unit = summary.table, summary.unit
    shown = panels(summary)
    limits = error_limits([unit.factor * median_over_last(panel.error) for panel in shown])
    costs = np.concatenate([panel.cost.ravel() for panel in shown])
    costs = costs[np.isfinite(costs) & (costs > 0.0)]

    def draw(ax: Axes, panel: Panel) -> None:
        points = []
        for k, line in enumerate(table.lines):
            error = unit.factor * median_over_last(panel.error[k])
            ax.plot(panel.cost[k], error, "o-", ms=3.5, lw=1.0, color=colour_of(k), label=line, zorder=3)
            for c, (x, y) in enumerate(zip(panel.cost[k], error, strict=True)):
                if np.isfinite(x + y):
                    points.append((float(x), float(y)))
                    is_valley = 0 < c < len(error) - 1 and bool(y < min(error[c - 1], error[c + 1]))
                    ax.annotate(
                        str(table.counts[c]), (x, y), xytext=(0, -4 if is_valley else 4), textcoords="offset points",
                        fontsize=6.5, ha="center", va="top" if is_valley else "bottom", color=colour_of(k), zorder=5,
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
        plain_numbers(ax.xaxis)
        error_axis(ax, limits)

    words = f"{table.measure.words} [{unit.name}]" if unit.name else table.measure.words
    return panel_figure(table, shown, draw, "time per update [ms]", words)


def pareto_front(points: NDArray[np.float64]) -> list[int]:
    """Rows of the Pareto-optimal points among (n, 2), both columns to be minimised, sorted by the first column."""
    front: list[int] = []
    for row in np.lexsort((points[:, 1], points[:, 0])):
        if not front or points[row, 1] < points[front[-1], 1]:
            front.append(int(row))
    return front
