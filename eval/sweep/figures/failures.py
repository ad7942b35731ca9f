# SPDX-License-Identifier: MIT
"""Failed runs of all runs, for each filter and count."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from eval.report.plots import BAD
from eval.sweep.figures.layout import panel_figure
from eval.sweep.panels import Panel, panels
from eval.sweep.statistics import wilson_interval
from eval.sweep.summary import SweepSummary


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
    return panel_figure(table, panels(summary), draw, "particles", "", height=height, left=left, entries=0)


def _write_into_cell(ax: Axes, x: float, y: float, text: str, *, size: float, smallest: float, color: str) -> None:
    """Write a text as large as its cell of width 1 allows; not at all if it would be too small to read [pt]."""
    width = 72.0 * ax.get_figure().get_figwidth() * ax.get_position().width / (ax.get_xlim()[1] - ax.get_xlim()[0])  # type: ignore[union-attr]
    fitting = min(size, width / (0.62 * len(text)))
    if fitting >= smallest:
        ax.text(x, y, text, ha="center", va="center", fontsize=fitting, color=color)
