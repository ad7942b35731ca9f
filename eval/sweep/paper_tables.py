# SPDX-License-Identifier: MIT
"""Tables of a sweep for a paper, in Markdown and LaTeX: medians, failures, and the paired differences that decide."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eval.sweep.answer_words import after_seeds, difference_words
from eval.sweep.look_schedule import fewest_seeds_to_go_on
from eval.sweep.measure import Unit
from eval.sweep.panels import Panel, panels
from eval.sweep.remarks import (
    MAX_NAMED,
    after_final_pass,
    described,
    look_rule,
    margin_choice,
    margin_words,
    never_resampled,
)
from eval.sweep.results import SweepTable
from eval.sweep.statistics import bootstrap_interval, min_values, paired_difference
from eval.sweep.summary import SweepSummary

MARK = "*"
"""Marks the number of runs where it is too small for an interval."""


def markdown_table(summary: SweepSummary) -> str:
    """Markdown table with a short caption above and the method below; rows and columns as in `latex_table`."""
    blocks = ["\n".join(_markdown_row(row) for row in _with_rule(part)) for part in _parts(summary)]
    return "\n\n".join([_caption(summary), *blocks, f"Method: {_method(summary)}"]) + "\n"


def latex_table(summary: SweepSummary) -> str:
    """LaTeX table (package booktabs): one row per world and particle count and one for the answer.

    With a single line, errors and differences stand side by side. With several lines each has a column, and the
    differences follow in a second part: seven particle counts side by side would be wider than a page. The caption is
    short; how the figures were obtained is a paragraph after the table, for the text of the paper.
    """
    parts = "\n  \\par\\medskip\n".join(map(_latex_tabular, _parts(summary)))
    return (
        "% needs \\usepackage{booktabs}; table* spans both columns of a two-column paper\n"
        "\\begin{table*}\n  \\centering\\footnotesize\n"
        f"  \\caption{{{_escaped(_caption(summary))}}}\n{parts}\n  \\label{{tab:particles}}\n\\end{{table*}}\n"
        f"\\paragraph{{Method.}} {_latex_text(_method(summary))}\n"
    )


@dataclass(frozen=True)
class _Part:
    """A table: its head, and the rows of each world or kind of building."""

    head: list[str]
    blocks: list[list[list[str]]]


def _parts(summary: SweepSummary) -> list[_Part]:
    """One table for a single line, two for several: of the errors and of the differences."""
    table, shown = summary.table, panels(summary)
    lines, several = range(len(table.lines)), len(table.lines) > 1
    names = list(table.lines) if several else ["error"]
    bracket = f"{100.0 * table.level:.3g} %" if summary.has_intervals else "range"
    against = f"against {table.counts[-1]} [{bracket}]"
    errors = _Part([*_HEAD, *names], [_rows(summary, p, lambda p, c: _errors(summary, p, c, lines)) for p in shown])
    if len(table.counts) < 2:
        return [errors]
    differences = [_rows(summary, p, lambda p, c: _differences(summary, p, c, lines)) for p in shown]
    if several:
        return [errors, _Part([against, *_HEAD[1:], *names], differences)]
    beside = [
        [row + other[len(_HEAD) :] for row, other in zip(block, others, strict=True)]
        for block, others in zip(errors.blocks, differences, strict=True)
    ]
    beside = [[*block[:-1], [*block[-1][:-1], ""]] for block in beside]  # the answer stands once
    return [_Part([*errors.head, against], beside)]


_HEAD = ["world", "particles", "runs"]


def _rows(summary: SweepSummary, panel: Panel, cells: Callable[[Panel, int], list[str]]) -> list[list[str]]:
    """The rows of a world: one per count, and one for the answers."""
    place = panel.answer.place
    rows = [
        [place, str(count), _marked_runs(summary, panel, c), *cells(panel, c)]
        for c, count in enumerate(summary.table.counts)
    ]
    return [*rows, [place, "enough", "", *panel.enough]]


def _errors(summary: SweepSummary, panel: Panel, c: int, lines: Iterable[int]) -> list[str]:
    return [_cell(panel, k, c, summary.unit) for k in lines]


def _differences(summary: SweepSummary, panel: Panel, c: int, lines: Iterable[int]) -> list[str]:
    """The paired differences of a count to the largest one, with the intervals that decide."""
    unit = replace(summary.unit, name="")
    if c == len(summary.table.counts) - 1:
        return ["" for _ in lines]
    return [_difference(summary, panel, k, c, unit) for k in lines]


def _difference(summary: SweepSummary, panel: Panel, k: int, c: int, unit: Unit) -> str:
    """The difference that decides; where that is of an earlier look, that of all runs too."""
    decision = panel.decisions[k]
    text = difference_words(decision.differences[c], unit, decision.limits[c]) or "-"
    if first := after_seeds(decision, c, "({})"):
        of_all = paired_difference(panel.error[k, c], panel.error[k, -1], level=summary.table.level)
        return f"{text} {first}; all {difference_words(of_all, unit)}"
    return text


def _with_rule(part: _Part) -> list[list[str]]:
    return [part.head, ["---"] * len(part.head), *(row for block in part.blocks for row in block)]


def _markdown_row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _latex_tabular(part: _Part) -> str:
    body = "\n\\addlinespace\n".join("\n".join(map(_latex_row, block)) for block in part.blocks)
    return (
        f"  \\begin{{tabular}}{{lrr{'r' * (len(part.head) - len(_HEAD))}}}\n\\toprule\n"
        f"{_latex_row(part.head)}\n\\midrule\n{body}\n\\bottomrule\n  \\end{{tabular}}"
    )


def _latex_row(cells: list[str]) -> str:
    return " & ".join(map(_latex_text, cells)) + r" \\"


def _latex_text(text: str) -> str:
    """Escaped text with a minus sign, which is longer than a hyphen, before negative numbers."""
    return _MINUS.sub("$-$", _escaped(text))


def _caption(summary: SweepSummary) -> str:
    """What the columns hold, as a journal takes it: two or three sentences."""
    table, unit = summary.table, summary.unit
    measure, largest = table.measure, table.counts[-1]
    name = f"{measure.words[0].upper()}{measure.words[1:]}{measure.definition}" + (
        f" [{unit.name}]" if unit.name else ""
    )
    brackets = "95 % interval" if summary.has_intervals else "smallest and largest run"
    failed = ", failed runs in parentheses" if table.failed.any() else ""
    sentences = [f"{name} of {measure.estimate_is} by number of particles: median [{brackets}]{failed}."]
    if len(table.counts) > 1:
        decides = f", with the {100.0 * table.level:.3g} % interval that decides" if summary.has_intervals else ""
        sentences += [
            f"Against {largest}: differences to {largest} particles on the same data{decides}.",
            f"Enough: at most {margin_words(summary)} worse than {largest} particles, with 95 % confidence.",
        ]
    sentences.append(margin_choice(table))  # no reader may take such an answer for a test
    if earlier := _earlier_looks(summary):
        numbers = " and ".join(f"({number})" for number in earlier)
        sentences.append(
            f"{numbers}: of the first {' or '.join(map(str, earlier))} seeds, which decided; all: of all runs."
        )
    if _has_marks(summary):
        sentences.append(f"{MARK} Too few runs for an interval: smallest and largest run.")
    return " ".join(filter(None, sentences))


def _earlier_looks(summary: SweepSummary) -> list[int]:
    """After how many seeds verdicts fell at an earlier look than the last one."""
    decisions = [decision for panel in panels(summary) for decision in panel.decisions]
    return sorted({seeds for decision in decisions for seeds in decision.seeds if seeds < decision.looked_at})


def figure_caption(summary: SweepSummary) -> str:
    """A caption for the figure of the paired differences, which decide; empty with a single count."""
    table = summary.table
    if len(table.counts) < 2:
        return ""
    measure, largest = table.measure, table.counts[-1]
    marks = "Filled: shown to be within the margin (dashed); cross: shown to be worse; hollow: open."
    what = (
        f"their median with the {100.0 * table.level:.3g} % interval that decides. {marks}"
        if summary.has_intervals
        else "their median. The runs are too few for intervals."
    )
    numbers = {place: table.seeds_of(p) for p, place in enumerate(table.places)}
    each = f" ({_runs_of(numbers)})" if len(numbers) <= MAX_NAMED else ""
    earlier = " or ".join(map(str, _earlier_looks(summary)))
    decided = f" Where the first {earlier} seeds decided, marks are of these." if earlier else ""
    return (
        f"{measure.words[0].upper()}{measure.words[1:]} of {measure.estimate_is}, above that with {largest} particles "
        f"on the same data, by number of particles. Dots: runs{each}; large marks: {what}{decided} Triangles "
        f"and arrow heads: beyond the axis. Margin: {margin_words(summary)}."
    )


def _runs_of(numbers: Mapping[str, int]) -> str:
    """`8 for each count`, `loop 8, apartment 16 for each count`; numbers: runs of each count, by place."""
    if len(set(numbers.values())) == 1:
        return f"{next(iter(numbers.values()))} for each count"
    return f"{', '.join(f'{place} {number}' for place, number in numbers.items())} for each count"


def _method(summary: SweepSummary) -> str:
    """How the figures were obtained: the runs, the statistics, the looks, the final pass."""
    table = summary.table
    sentences = ["Medians are over the runs, one per seed."]
    if table.family_names():
        sentences.append("For a kind of building they are over its worlds, each with the median of its seeds.")
    if summary.has_intervals:
        sentences.append(
            "Intervals of medians, and of the median differences that decide, are from the expanded percentile "
            "bootstrap (Hesterberg 2015)."
        )
    if len(table.counts) > 1:
        if summary.has_intervals:
            sentences.append(
                "What decides is the median of the paired differences with its interval, not those of the errors."
            )
        sentences.append(
            "A count is enough if all larger counts are enough too, and if it did not fail more often; that it fails "
            "more often is shown by McNemar's exact test, one-sided."
        )
    sentences.append(look_rule(table))
    if _fewest_units(summary) < min_values():
        fewest, unit = fewest_seeds_to_go_on(table.level), "worlds" if table.family_names() else "runs"
        sentences.append(f"At least {fewest} {unit} are needed to show that a count is enough.")
    final_pass = after_final_pass(summary)
    sentences.append(f"After the final pass, which is no part of the filter, {final_pass}" if final_pass else "")
    few = never_resampled(summary)
    sentences += [f"{few[0].upper()}{few[1:]}" if few else "", "" if table.failed.any() else "No run failed."]
    return " ".join(filter(None, [*sentences, described(table), _version(table)]))


def _version(table: SweepTable) -> str:
    """Which software computed the runs; the commit is unknown in tables of versions up to 0.1."""
    commit = table.commit if not table.commit or table.commit.startswith("slam-testbed ") else f"commit {table.commit}"
    known = ", ".join(filter(None, (commit.removeprefix("slam-testbed "), f"code version {table.code}")))
    return f"Computed with slam-testbed ({known})."


def _has_marks(summary: SweepSummary) -> bool:
    """Whether some numbers of runs are marked, since others suffice for an interval."""
    counts = range(len(summary.table.counts))
    return any(_is_marked(summary, panel, c) for panel in panels(summary) for c in counts)


def _is_marked(summary: SweepSummary, panel: Panel, c: int) -> bool:
    """Whether the runs with a count are too few for an interval, and others are not; no runs need no mark."""
    return summary.has_intervals and 0 < int(panel.units[:, c].min()) < min_values()


def _fewest_units(summary: SweepSummary) -> int:
    """The smallest number of runs of a world, or of worlds of a kind of building, that a median rests on."""
    return min((int(panel.units.min()) for panel in panels(summary)), default=0)


def _marked_runs(summary: SweepSummary, panel: Panel, c: int) -> str:
    """Number of runs with a count, marked where they are too few for an interval and others are not."""
    return runs_text(panel.runs[:, c]) + (f" {MARK}" if _is_marked(summary, panel, c) else "")


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


_MINUS = re.compile(r"(?<![\w.])-(?=\d)")
_LATEX = str.maketrans(
    {mark: f"\\{mark}" for mark in "%_&#${}"}
    | {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
)


def _escaped(text: str) -> str:
    return text.translate(_LATEX)
