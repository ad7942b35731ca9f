# SPDX-License-Identifier: MIT
"""Tables of a sweep for a paper, in Markdown and LaTeX: medians with intervals, and failures."""

from __future__ import annotations

import numpy as np

from eval.sweep.measure import Unit
from eval.sweep.panels import Panel, panels
from eval.sweep.statistics import bootstrap_interval
from eval.sweep.summary import SweepSummary


def markdown_table(summary: SweepSummary) -> str:
    """Markdown table: one row per world (or kind of building) and line, one column per particle count."""
    table = summary.table
    head = ["world", "filter", *map(str, table.counts)]
    rows = [
        [panel.answer.place, line, *(_cell(panel, k, c, summary.unit) for c in range(len(table.counts)))]
        for panel in panels(summary)
        for k, line in enumerate(table.lines)
    ]
    lines = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
    return f"{_caption(summary)}\n\n" + "\n".join(lines) + "\n"


def latex_table(summary: SweepSummary) -> str:
    """LaTeX table (package booktabs): one row per world and particle count, one column per line.

    Seven particle counts side by side would be wider than a page.
    """
    table = summary.table
    head = ["world", "particles", *table.lines]
    blocks = [
        "\n".join(
            _latex_row(
                [panel.answer.place, str(count), *(_cell(panel, k, c, summary.unit) for k in range(len(table.lines)))]
            )
            for c, count in enumerate(table.counts)
        )
        for panel in panels(summary)
    ]
    body = "\n\\addlinespace\n".join(blocks)
    return (
        "\\begin{table}\n  \\centering\\footnotesize\n"
        f"  \\caption{{{_escaped(_caption(summary))}}}\n"
        f"  \\begin{{tabular}}{{lr{'r' * len(table.lines)}}}\n\\toprule\n"
        f"{_latex_row(head)}\n\\midrule\n{body}\n\\bottomrule\n"
        "  \\end{tabular}\n\\end{table}\n"
    )


def _latex_row(cells: list[str]) -> str:
    return " & ".join(map(_escaped, cells)) + r" \\"


def _caption(summary: SweepSummary) -> str:
    table, unit = summary.table, summary.unit
    measure = table.measure
    name = f"{measure.words[0].upper()}{measure.words[1:]}" + (f" [{unit.name}]" if unit.name else "")
    over = f"{len(table.seeds)} seed{'s' if len(table.seeds) > 1 else ''}"
    if table.family_names():
        over += ", over the worlds for a kind of building"
    return (
        f"{name} of {measure.estimate_is} by number of particles: median over {over}, "
        "95 % bootstrap interval in brackets, failed runs in parentheses where there are any."
    )


def _cell(panel: Panel, k: int, c: int, unit: Unit) -> str:
    """Text of one group: median, interval, failures."""
    m = bootstrap_interval(panel.error[k, c], np.median)
    if m.count == 0:
        return "-"
    digits = _digits(unit.factor * m.value)
    text = f"{unit.factor * m.value:.{digits}f}"
    if np.isfinite(m.low):
        text += f" [{unit.factor * m.low:.{digits}f}, {unit.factor * m.high:.{digits}f}]"
    return f"{text} ({panel.failed[k, c]}/{panel.runs[k, c]})" if panel.failed[k, c] else text


def _digits(value: float) -> int:
    """Number of decimals that leaves two or three significant digits."""
    return 2 if abs(value) < 10.0 else 1 if abs(value) < 100.0 else 0


_LATEX = str.maketrans(
    {mark: f"\\{mark}" for mark in "%_&#${}"}
    | {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
)


def _escaped(text: str) -> str:
    return text.translate(_LATEX)
