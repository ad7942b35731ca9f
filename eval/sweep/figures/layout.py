# SPDX-License-Identifier: MIT
"""Panels of a sweep's figures: one per world or kind of building, with shared axes and one legend.

Figures are as wide as one or two columns of a journal, and their fonts do not depend on the number of panels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eval.report.plots import STYLE
from eval.sweep.panels import Panel
from eval.sweep.results import SweepTable

WIDTHS = (3.5, 5.3, 7.16)
"""Width of a figure with 1, 2, 3 panels in a row [inch]; the first and the last are one and two columns of a page."""
PANEL_HEIGHT = 2.0
"""Height of a row of panels [inch]."""
LEGEND_ROW = 0.17
"""Height of a row of the legend [inch]."""
_BETWEEN_ROWS, _BETWEEN_COLUMNS, _BELOW, _RIGHT = 0.34, 0.14, 0.42, 0.14
"""Margins between and around panels [inch]."""
Draw = Callable[[Axes, Panel], None]


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


def panel_figure(
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
