# SPDX-License-Identifier: MIT
"""Tables of a sweep for a paper, in Markdown and LaTeX: medians with intervals, and failures."""

from __future__ import annotations

import numpy as np

from eval.sweep.plots import Unit
from eval.sweep.summary import SweepSummary


def markdown_table(summary: SweepSummary) -> str:
    """Markdown table: one row per world and line, one column per particle count."""
    table = summary.table
    head = ["place", "filter", *map(str, table.counts)]
    rows = [
        [place, line, *(_cell(summary, place, line, count) for count in table.counts)]
        for place in table.places
        for line in table.lines
    ]
    lines = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
    return f"{_caption(summary)}\n\n" + "\n".join(lines) + "\n"


def latex_table(summary: SweepSummary) -> str:
    """LaTeX table (package booktabs): one row per world and particle count, one column per line.

    Seven particle counts side by side would be wider than a page.
    """
    table = summary.table
    head = ["place", "particles", *table.lines]
    blocks = [
        "\n".join(
            _latex_row([place, str(count), *(_cell(summary, place, line, count) for line in table.lines)])
            for count in table.counts
        )
        for place in table.places
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


def enough_words(count: int | None, largest: int) -> str:
    """The answer of `SweepSummary.enough` in a table."""
    return str(count) if count is not None else f"not shown up to {largest}"


def _caption(summary: SweepSummary) -> str:
    table, unit = summary.table, Unit.of(summary.table.measure)
    return (
        f"{unit.words[0].upper()}{unit.words[1:]} by number of particles: median over {len(table.seeds)} seeds, "
        "95 % bootstrap interval in brackets, failed runs in parentheses where there are any."
    )


def _cell(summary: SweepSummary, place: str, line: str, count: int) -> str:
    """Text of one group: median, interval, failures."""
    group, factor = summary.group(place, line, count), Unit.of(summary.table.measure).factor
    m = group.median
    if m.count == 0:
        return "-"
    digits = _digits(factor * m.value)
    text = f"{factor * m.value:.{digits}f}"
    if np.isfinite(m.low):
        text += f" [{factor * m.low:.{digits}f}, {factor * m.high:.{digits}f}]"
    return f"{text} ({group.failures}/{group.runs})" if group.failures else text


def _digits(value: float) -> int:
    """Number of decimals that leaves two or three significant digits."""
    return 2 if abs(value) < 10.0 else 1 if abs(value) < 100.0 else 0


_LATEX = str.maketrans(
    {mark: f"\\{mark}" for mark in "%_&#${}"}
    | {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
)


def _escaped(text: str) -> str:
    return text.translate(_LATEX)
