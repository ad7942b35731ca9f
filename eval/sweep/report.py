# SPDX-License-Identifier: MIT
"""Report of a sweep: sweep.html (needs no network), figures as SVG and PDF, tables for a paper."""

from __future__ import annotations

import base64
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eval.files.atomic_write import atomic_write
from eval.report.page import Plot, render
from eval.sweep import plots as sweep_plots
from eval.sweep.paper_tables import enough_words, latex_table, markdown_table
from eval.sweep.plots import Unit
from eval.sweep.results import read_sweep
from eval.sweep.statistics import LEVEL, MIN_SEEDS, POWER, TOLERANCE, Interval
from eval.sweep.summary import Group, SweepSummary, WorstRun, summarise, worst_runs

Draw = Callable[[SweepSummary], Figure]


@dataclass(frozen=True)
class Drawing:
    """A figure of the report."""

    name: str
    """Stem of its files."""
    title: str
    draw: Draw
    caption: str


DRAWINGS = (
    Drawing(
        "accuracy",
        "Accuracy against particle count",
        sweep_plots.accuracy,
        "Medians over the seeds with 95 % bootstrap intervals; every run is a faint dot. Both axes are logarithmic.",
    ),
    Drawing(
        "failures",
        "Runs that failed",
        sweep_plots.failures,
        "Share of the seeds that ended lost, with broken loops or without a result, with 95 % Wilson intervals.",
    ),
    Drawing(
        "cost",
        "Cost against accuracy",
        sweep_plots.cost_against_accuracy,
        "Time in the filter per update against the median error. The black line joins what nothing else beats in both; "
        "the numbers are particle counts. Times are those of the machine of this sweep.",
    ),
    Drawing(
        "honesty",
        "Does the filter know how large its error is?",
        sweep_plots.coverage_of_95_percent,
        "Share of the updates with the true pose inside the 95 % ellipsoid of the particles. Below the dashed line the "
        "filter is overconfident (Bailey, Nieto, Nebot 2006).",
    ),
    Drawing(
        "ess",
        "Effective sample size along the run",
        partial(sweep_plots.health, curve="ess", label="effective particles [%]"),
        "Effective sample size as a share of the particles, for the baseline, median over the seeds.",
    ),
    Drawing(
        "ancestors",
        "Ancestors along the run",
        partial(sweep_plots.health, curve="unique_ancestors", label="unique ancestors [%]"),
        "Unique ancestors of the current particles as a share of their number, for the baseline, median over seeds. "
        "When one ancestor is left, counting starts again.",
    ),
)


def write_sweep_report(directory: str | os.PathLike[str]) -> Path:
    """Write `sweep.html`, `figures/*.svg`, `figures/*.pdf`, `table.md` and `table.tex` into a sweep's directory.

    The page links the runs in `worst/KEY`. Returns the path of the page; raises SweepTableError for damaged tables.
    """
    folder = Path(directory)
    summary = summarise(read_sweep(folder))
    (folder / "figures").mkdir(exist_ok=True)
    plots = [_plot(drawing, summary, folder / "figures") for drawing in DRAWINGS]
    tables = {"table.md": markdown_table(summary), "table.tex": latex_table(summary)}
    page = render("sweep.html.j2", **_context(folder, summary), plots=plots, tables=tables)
    for name, text in (tables | {"sweep.html": page}).items():
        with atomic_write(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return folder / "sweep.html"


def _plot(drawing: Drawing, summary: SweepSummary, folder: Path) -> Plot:
    """Write a figure to its files; the page shows the SVG."""
    svg = folder / f"{drawing.name}.svg"
    with sweep_plots.style():
        figure = drawing.draw(summary)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once for both files
        for path, metadata in (
            (svg, {"Date": None, "Creator": None}),
            (svg.with_suffix(".pdf"), {"CreationDate": None}),
        ):
            with atomic_write(path) as temporary:
                figure.savefig(temporary, format=path.suffix[1:], metadata=metadata)
    source = "data:image/svg+xml;base64," + base64.b64encode(svg.read_bytes()).decode()
    return Plot(drawing.title, source, f"{drawing.caption} Files: figures/{drawing.name}.svg, .pdf.")


def _context(folder: Path, summary: SweepSummary) -> dict[str, Any]:
    table, unit = summary.table, Unit.of(summary.table.measure)
    return {
        "title": table.title or "Sweep",
        "lead": _lead(summary),
        "table": table,
        "unit": unit,
        "missing": int((~table.ran).sum()),
        "without_result": int((table.columns["status"].astype(str) == "failed").sum()),
        "failed": int(table.failed.sum()),
        "runs": int(table.ran.sum()),
        "enough": [
            (place, [enough_words(summary.enough(place, line), table.counts[-1]) for line in table.lines])
            for place in table.places
        ],
        "differences": [row for group in summary.groups if (row := _difference_row(group, unit)) is not None],
        "worst": [(run, unit.factor * run.error, _links(folder, run)) for run in worst_runs(table)],
        "level": LEVEL,
        "power": POWER,
        "min_seeds": MIN_SEEDS,
        "tolerance": TOLERANCE,
    }


def _lead(summary: SweepSummary) -> str:
    """The answer for the baseline in one sentence."""
    table = summary.table
    counts = [summary.enough(place, table.baseline) for place in table.places]
    known = sorted(count for count in counts if count is not None)
    if not known and len(table.seeds) < MIN_SEEDS:
        return f"{len(table.seeds)} seeds are too few to tell how many particles are enough."
    if not known:
        return f"Up to {table.counts[-1]} particles, no count is shown to be enough."
    span = f"{known[0]}" if known[0] == known[-1] else f"{known[0]} to {known[-1]}"
    where = "everywhere" if len(known) == len(counts) else f"in {len(known)} of {len(counts)} places"
    return f"{span} particle{'s' if known[-1] > 1 else ''} {'are' if known[-1] > 1 else 'is'} enough {where}."


def _difference_row(group: Group, unit: Unit) -> tuple[Group, str, str, str] | None:
    """Row of the differences to the baseline and to the largest count; None if there are none."""
    if group.to_baseline is None and group.to_largest is None:
        return None
    detectable = f"{unit.factor * group.detectable:.2f}" if np.isfinite(group.detectable) else "–"
    return group, _difference(group.to_baseline, unit), _difference(group.to_largest, unit), detectable


def _difference(interval: Interval | None, unit: Unit) -> str:
    """A difference with its interval, and a star if the interval excludes 0."""
    if interval is None or interval.count == 0:
        return "–"
    text = f"{unit.factor * interval.value:+.2f}"
    if interval.count < 2:
        return text
    star = "" if interval.contains(0.0) or interval.count < MIN_SEEDS else " *"
    return f"{text} [{unit.factor * interval.low:+.2f}, {unit.factor * interval.high:+.2f}]{star}"


def _links(folder: Path, run: WorstRun) -> list[tuple[str, str]]:
    """Links to the files of a repeated run, relative to the page."""
    files = {"report": "report.html", "recording": "recording.rrd"}
    return [
        (word, f"worst/{run.key}/{file}")
        for word, file in files.items()
        if (folder / "worst" / run.key / file).is_file()
    ]
