# SPDX-License-Identifier: MIT
"""Tables of a sweep for a paper, in Markdown and LaTeX: medians with intervals, and failures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eval.sweep.measure import Unit
from eval.sweep.panels import Panel, panels
from eval.sweep.remarks import described, margin_words
from eval.sweep.statistics import bootstrap_interval, min_values
from eval.sweep.summary import SweepSummary

MARK = "*"
"""Marks the number of runs where it is too small for an interval."""


def markdown_table(summary: SweepSummary) -> str:
    """Markdown table; rows and columns as in `latex_table`."""
    head, blocks = _content(summary)
    rows = [head, ["---"] * len(head), *(row for block in blocks for row in block)]
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return f"{_caption(summary)}\n\n" + "\n".join(lines) + "\n"


def latex_table(summary: SweepSummary) -> str:
    """LaTeX table (package booktabs): one row per world and particle count and one for the answer, one column per line.

    Seven particle counts side by side would be wider than a page.
    """
    head, blocks = _content(summary)
    body = "\n\\addlinespace\n".join("\n".join(map(_latex_row, block)) for block in blocks)
    return (
        "\\begin{table}\n  \\centering\\footnotesize\n"
        f"  \\caption{{{_escaped(_caption(summary))}}}\n"
        f"  \\begin{{tabular}}{{lrr{'r' * len(summary.table.lines)}}}\n\\toprule\n"
        f"{_latex_row(head)}\n\\midrule\n{body}\n\\bottomrule\n"
        "  \\end{tabular}\n\\end{table}\n"
    )


def _content(summary: SweepSummary) -> tuple[list[str], list[list[list[str]]]]:
    """The head of the table, and for each world (or kind of building) its rows."""
    table = summary.table
    head = ["world", "particles", "runs", *(table.lines if len(table.lines) > 1 else ["error"])]
    blocks = []
    for panel in panels(summary):
        place = panel.answer.place
        rows = [
            [
                place,
                str(count),
                _marked_runs(panel.runs[:, c]),
                *(_cell(panel, k, c, summary.unit) for k in range(len(table.lines))),
            ]
            for c, count in enumerate(table.counts)
        ]
        blocks.append([*rows, [place, "enough", "", *panel.enough]])
    return head, blocks


def _latex_row(cells: list[str]) -> str:
    return " & ".join(map(_escaped, cells)) + r" \\"


def _caption(summary: SweepSummary) -> str:
    table, unit = summary.table, summary.unit
    measure = table.measure
    name = f"{measure.words[0].upper()}{measure.words[1:]}" + (f" [{unit.name}]" if unit.name else "")
    over = "the runs (one per seed)"
    if table.family_names():
        over += ", over the worlds for a kind of building"
    few, runs = min_values(), [int(n) for n in table.ran.sum(axis=-1).ravel()]
    brackets = "95 % bootstrap interval" if max(runs, default=0) >= few else "range"
    sentences = [
        f"{name} of {measure.estimate_is} by number of particles: median over {over}, "
        f"{brackets} in brackets, failed runs in parentheses where there are any.",
        f"Enough: with 95 % confidence at most {margin_words(summary)} worse than {table.counts[-1]} particles.",
    ]
    if min(runs, default=0) < few:
        sentences.append(
            f"{MARK} Fewer than {few} runs: the brackets hold the smallest and the largest run, and no count can be "
            "shown to be enough."
        )
    return " ".join([*sentences, described(table)])


def _marked_runs(runs: NDArray[np.int64]) -> str:
    return runs_text(runs) + (f" {MARK}" if int(np.min(runs)) < min_values() else "")


def runs_text(runs: NDArray[np.int64]) -> str:
    """Number of runs, or the smallest and largest number if they differ."""
    low, high = int(np.min(runs)), int(np.max(runs))
    return str(low) if low == high else f"{low} to {high}"


def _cell(panel: Panel, k: int, c: int, unit: Unit) -> str:
    """Text of one group: median, interval (for fewer units than one needs: range), failures."""
    m = bootstrap_interval(panel.error[k, c], np.median)
    if 1 < m.count < min_values():
        m = replace(m, low=float(np.nanmin(panel.error[k, c])), high=float(np.nanmax(panel.error[k, c])))
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
