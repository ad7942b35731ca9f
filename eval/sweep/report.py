# SPDX-License-Identifier: MIT
"""Report of a sweep: sweep.html (needs no network), figures as SVG and PDF, tables for a paper."""

from __future__ import annotations

import base64
import io
import os
import shlex
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eval.files.atomic_write import atomic_write
from eval.report.page import render
from eval.sweep.advice import advice
from eval.sweep.answer_words import after_seeds, difference_words
from eval.sweep.answers import Answer, answer_of_place, answers
from eval.sweep.figures.accuracy import accuracy
from eval.sweep.figures.cost import cost_against_accuracy
from eval.sweep.figures.differences import differences
from eval.sweep.figures.failures import failures
from eval.sweep.figures.filter_health import coverage_of_95_percent, health
from eval.sweep.figures.layout import style
from eval.sweep.forecast_remarks import forecast_against_runs, suggested_counts
from eval.sweep.look_schedule import fewest_seeds_to_go_on
from eval.sweep.measure import Unit
from eval.sweep.needed_count import shipped_model
from eval.sweep.paper_tables import figure_caption, latex_table, markdown_table, runs_text
from eval.sweep.remarks import (
    MAX_NAMED,
    after_final_pass,
    described,
    look_rule,
    margin_choice,
    margin_words,
    never_resampled,
    overconfidence,
    real_time,
    seeds_change,
)
from eval.sweep.results import LEFT_OUT, SweepTable, read_sweep
from eval.sweep.statistics import LEVEL, POWER, Interval, min_values
from eval.sweep.summary import Group, SweepSummary, WorstRun, summarise, worst_runs

Draw = Callable[[SweepSummary], Figure]
PIXELS_PER_INCH = 155
"""Scale of the figures on the page: the same for all, so that fonts are equal."""


@dataclass(frozen=True)
class Drawing:
    """A figure of the report."""

    name: str
    """Stem of its files."""
    title: str
    draw: Draw
    caption: str
    caption_of_few: str = ""
    """Caption where no count has enough runs for an interval; empty = `caption`."""
    is_first: bool = False
    """Whether it stands before the tables."""
    decides: bool = False
    """Whether the answers follow from it: it stands directly below them."""


_ZONE_AND_PASS = (
    "Green zone, as in the figure below the answers: errors at most the margin above that of the largest count; a "
    "hollow point in it is open all the same. "
    "Dotted: after the final pass, which re-estimates the whole path and is not part of the particle filter."
)
DRAWINGS = (
    Drawing(
        "accuracy",
        "Accuracy against particle count",
        accuracy,
        "Line: median. Band: 95 % interval of the median (none where there are too few runs), which does not decide: "
        "the figure below the answers shows what does. Faint dots: single runs (triangle: beyond the axis). "
        f"{_ZONE_AND_PASS}",
        f"Line: median. Dots: single runs (triangle: beyond the axis). {_ZONE_AND_PASS}",
        is_first=True,
    ),
    Drawing(
        "differences",
        "What decides: paired differences to the largest count",
        differences,
        "How much worse each count is than the largest one on the same data: dots for the runs, their median, and the "
        "interval that decides. A count passes its own test (filled) where the whole interval lies in the green zone, "
        "below the dashed margin, and is shown to be worse (cross) where it lies above; otherwise it is open (hollow). "
        "With as few as 8 runs the interval reaches nearly from the smallest to the largest.",
        "How much worse each count is than the largest one on the same data: dots for the runs, a circle for their "
        "median. Green zone: at most the margin worse. These runs are too few for the interval that decides: with "
        f"{fewest_seeds_to_go_on(LEVEL)} seeds it is drawn, and where it lies below the dashed margin the count is as "
        "good as the largest.",
        is_first=True,
        decides=True,
    ),
    Drawing(
        "failures",
        "Failed runs",
        failures,
        "Runs that ended lost, with broken loops or without a result, of all runs. Small figures: the failure rates "
        "that are compatible with it (95 % Wilson interval).",
        is_first=True,
    ),
    Drawing(
        "cost",
        "Cost against accuracy",
        cost_against_accuracy,
        "Time of the filter per update and median error; numbers are particle counts. Grey discs and line: the "
        "front, the points than which no other is both faster and better. Times depend on the machine.",
        is_first=True,
    ),
    Drawing(
        "honesty",
        "Does the filter know how large its error is?",
        coverage_of_95_percent,
        "Share of the updates with the true pose inside the 95 % ellipsoid of the particles. Below the dashed line the "
        "filter is overconfident (Bailey, Nieto, Nebot 2006).",
    ),
    Drawing(
        "ess",
        "Effective sample size along the run",
        partial(health, curve="ess", label="effective particles [%]"),
        "Effective sample size as a share of the particles, median over the runs.",
    ),
    Drawing(
        "ancestors",
        "Ancestors along the run",
        partial(health, curve="unique_ancestors", label="unique ancestors [%]"),
        "Unique ancestors of the current particles as a share of their number, median over the runs. "
        "When one ancestor is left, counting starts again.",
    ),
)


@dataclass(frozen=True)
class ShownFigure:
    """A figure on the page."""

    drawing: Drawing
    caption: str
    source: str
    """`data:` address."""
    width: int
    """Width on the page [px]."""
    note: str
    """A sentence with figures of this sweep, below the caption; often empty."""


def write_sweep_report(directory: str | os.PathLike[str]) -> Path:
    """Write `sweep.html`, `figures/*.svg`, `figures/*.pdf`, `table.md` and `table.tex` into a sweep's directory.

    The page links the runs in `worst/KEY`. Returns the path of the page; raises SweepTableError for damaged tables.
    """
    folder = Path(directory)
    summary = summarise(read_sweep(folder).judged())
    (folder / "figures").mkdir(exist_ok=True)
    compares = len(summary.table.counts) > 1
    drawings = [drawing for drawing in DRAWINGS if compares or drawing.draw is not differences]
    figures = [_figure(drawing, summary, folder / "figures") for drawing in drawings]
    tables = {"table.md": markdown_table(summary), "table.tex": latex_table(summary)}
    page = render("sweep.html.j2", **_context(folder, summary), figures=figures, tables=tables)
    for name, text in (tables | {"sweep.html": page}).items():
        with atomic_write(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return folder / "sweep.html"


def _figure(drawing: Drawing, summary: SweepSummary, folder: Path) -> ShownFigure:
    """Write a figure to its files; the page shows the SVG."""
    svg = folder / f"{drawing.name}.svg"
    with style():
        figure = drawing.draw(summary)
        for path, metadata in (
            (svg, {"Date": None, "Creator": None}),
            (svg.with_suffix(".pdf"), {"CreationDate": None}),
        ):
            with atomic_write(path) as temporary:
                drawn = io.BytesIO()  # on a full disk matplotlib fails in ways that do not name the file
                figure.savefig(drawn, format=path.suffix[1:], metadata=metadata)
                temporary.write_bytes(drawn.getvalue())
    source = "data:image/svg+xml;base64," + base64.b64encode(svg.read_bytes()).decode()
    of_line = "" if len(summary.table.lines) == 1 else f"Shown for the line {summary.table.baseline}."
    notes = {
        "accuracy": described(summary.table),
        "cost": real_time(summary),
        "ess": of_line,
        "ancestors": of_line,
    }
    caption = drawing.caption if summary.has_intervals else drawing.caption_of_few or drawing.caption
    width = round(PIXELS_PER_INCH * float(figure.get_figwidth()))
    return ShownFigure(drawing, caption, source, width, notes.get(drawing.name, ""))


def _context(folder: Path, summary: SweepSummary) -> dict[str, Any]:
    table, unit = summary.table, summary.unit
    status = table.columns["status"].astype(str)
    enough_runs = table.ran.any(axis=(1, 2)).sum(axis=-1).max(initial=0) >= min_values(table.level)
    return {
        "title": table.title or "Sweep",
        "question": _question(table),
        "of_filter": table.measure.refined_key is not None,
        "answers": answers(summary, table.baseline),
        "others": _other_lines(summary),
        "worlds": _single_worlds(summary),
        "table": table,
        "unit": unit,
        "missing": int((status == "missing").sum()),
        "without_result": int((status == "failed").sum()),
        "failed": int(table.failed.sum()),
        "runs": int(table.ran.sum()),
        "routes": seeds_change(table),
        "seeds": _seeds(table),
        "seed_counts": runs_text(table.ran.any(axis=(1, 2)).sum(axis=-1)),
        "repeat": _repeat_command(table, folder),
        "figure_caption": figure_caption(summary),
        "final_pass": after_final_pass(summary),
        "suggested": suggested_counts(table),
        "forecast": forecast_against_runs(summary),
        "largest_predicted": shipped_model().max_count,
        "look_rule": look_rule(table),
        "margin_choice": margin_choice(table),
        "advice": advice(summary, str(folder), os.cpu_count() or 1),
        "workers": os.cpu_count() or 1,
        "margins": margin_words(summary),
        "goes_on": bool(np.isin(status, ("missing", "later")).any()),
        "left_out": int((status == LEFT_OUT).sum()),
        "commit": table.commit,
        "differences": [row for group in summary.groups if (row := _difference_row(summary, group)) is not None],
        "worst": [(run, unit.text(run.error), _links(folder, run)) for run in _shown_worst(folder, table)],
        "level": LEVEL,
        "power": POWER,
        "needed_seeds": None if enough_runs else fewest_seeds_to_go_on(table.level),
        "confidence": overconfidence(summary),
        "never_resampled": never_resampled(summary),
    }


def _question(table: SweepTable) -> str:
    """The question that the page answers, with what it is about."""
    if table.measure.needs_final_pass:
        return "How many particles are enough?"
    return "How many particles does the filter need?"


def _seeds(table: SweepTable) -> str:
    """Which seeds the page rests on: `0 to 7`, with the worlds where they differ."""
    of_place = {
        place: _ranges([seed for s, seed in enumerate(table.seeds) if table.ran[p, :, :, s].any()])
        for p, place in enumerate(table.places)
    }
    if len(set(of_place.values())) == 1:
        return next(iter(of_place.values()))
    if len(of_place) > MAX_NAMED:
        worlds = Counter(of_place.values())
        return "; ".join(f"{seeds} in {number} world{'s' * (number > 1)}" for seeds, number in worlds.items())
    return "; ".join(f"{place} {seeds}" for place, seeds in of_place.items())


def _ranges(seeds: Sequence[int]) -> str:
    """`0 to 7`, `0 to 2, 4 to 9`, `none`."""
    parts: list[list[int]] = []
    for seed in seeds:
        if parts and seed == parts[-1][-1] + 1:
            parts[-1].append(seed)
        else:
            parts.append([seed])
    texts = [str(part[0]) if len(part) == 1 else f"{part[0]} to {part[-1]}" for part in parts]
    return ", ".join(texts) or "none"


def _repeat_command(table: SweepTable, folder: Path) -> str:
    """The command that repeats the sweep in another directory; empty if it is unknown."""
    if not table.command:
        return ""
    command, mark, comment = table.command.partition("  # ")
    return f"{command} --out {shlex.quote(f'{folder.resolve().name}-again')}{mark}{comment}"


def _other_lines(summary: SweepSummary) -> list[tuple[str, list[str]]]:
    """The short answers of all filters, by world; empty if there is one filter only."""
    table = summary.table
    if len(table.lines) < 2:
        return []
    columns = [answers(summary, line) for line in table.lines]
    return [(row[0].place, [answer.short for answer in row]) for row in zip(*columns, strict=True)]


def _single_worlds(summary: SweepSummary) -> list[Answer]:
    """The answers of the worlds that are samples of a kind of building."""
    table = summary.table
    families = table.family_names()
    return [
        answer_of_place(summary, place, table.baseline)
        for place, family in zip(table.places, table.families, strict=True)
        if family in families
    ]


def _difference_row(summary: SweepSummary, group: Group) -> tuple[Group, str, str, str] | None:
    """Row of the differences to the baseline and to the largest count, which decide; None if there are none."""
    unit = summary.unit
    if group.to_baseline is None and group.to_largest is None:
        return None
    compared = group.to_baseline or group.to_largest
    is_known = compared is not None and compared.count >= min_values() and np.isfinite(group.detectable)
    detectable = f"{unit.factor * group.detectable:.2f}" if is_known else "–"
    to_largest = "–"
    if group.to_largest is not None:
        decision, c = summary.decision(group.place, group.line), summary.table.counts.index(group.count)
        to_largest = _difference(decision.differences[c], unit) + after_seeds(decision, c, " (first {} seeds)")
    return group, _difference(group.to_baseline, unit), to_largest, detectable


def _difference(interval: Interval | None, unit: Unit) -> str:
    """A difference with its interval, and a star if the interval excludes 0; the range for too few runs."""
    if interval is None or interval.count == 0:
        return "–"
    star = "" if interval.count < min_values() or interval.contains(0.0) else " *"
    return difference_words(interval, replace(unit, name="")) + star


def _shown_worst(folder: Path, table: SweepTable) -> list[WorstRun]:
    """The worst runs that failed or are unusual, or that one can look at."""
    return [run for run in worst_runs(table) if run.is_unusual or _links(folder, run)]


def _links(folder: Path, run: WorstRun) -> list[tuple[str, str]]:
    """Links to the files of a repeated run, relative to the page."""
    files = {"report": "report.html", "recording": "recording.rrd"}
    return [
        (word, f"worst/{run.key}/{file}")
        for word, file in files.items()
        if (folder / "worst" / run.key / file).is_file()
    ]
