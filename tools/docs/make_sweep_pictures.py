# SPDX-License-Identifier: MIT
"""Write the results part of docs/study.md and draw its pictures, from the directory of the shipped study.

    testbed sweep --preset particles --out study
    python -m tools.docs.make_sweep_pictures study

Writes: docs/study.md (study), docs/pictures/study_*.png

Text before and after the marks in the page is written by hand and is kept.
"""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path

import numpy as np

from eval.sweep.answers import answers
from eval.sweep.decision import median_over_last
from eval.sweep.figures.layout import style
from eval.sweep.panels import panels
from eval.sweep.paper_tables import markdown_table
from eval.sweep.report import DRAWINGS
from eval.sweep.results import read_sweep
from eval.sweep.summary import SweepSummary, summarise
from tools.pages import DOCS, write_table

PAGE = DOCS / "study.md"
OVERCONFIDENT = 0.8
"""A filter whose 95 % ellipsoid holds the truth less often than this is called overconfident."""


def draw(summary: SweepSummary) -> None:
    """All figures of the report as pictures."""
    for drawing in DRAWINGS:
        with style():
            drawing.draw(summary).savefig(DOCS / "pictures" / f"study_{drawing.name}.png", dpi=140)


def enough_table(summary: SweepSummary) -> str:
    """The short answers of all filters, by world."""
    table = summary.table
    columns = [answers(summary, line) for line in table.lines]
    rows = [["", *table.lines], ["---"] * (1 + len(table.lines))]
    rows += [[row[0].place, *(answer.short for answer in row)] for row in zip(*columns, strict=True)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def coverage_table(summary: SweepSummary) -> str:
    """How often the truth lies within the 95 % ellipsoid, for the baseline, by world and count."""
    table = summary.table
    rows = [["", *(str(count) for count in table.counts)], ["---"] * (1 + len(table.counts))]
    for panel in panels(summary):
        shares = median_over_last(panel.inside[table.lines.index(table.baseline)])
        rows.append([panel.answer.place, *("–" if np.isnan(share) else f"{100.0 * share:.0f} %" for share in shares)])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def sentences(summary: SweepSummary) -> list[str]:
    """What the figures show, in words."""
    table = summary.table
    base = table.lines.index(table.baseline)
    found = [answer.sentence for answer in answers(summary, table.baseline)]
    overconfident = [
        panel.answer.place for panel in panels(summary) if (median_over_last(panel.inside[base]) < OVERCONFIDENT).all()
    ]
    if overconfident:
        found.append(
            f"Overconfident whatever the count: {', '.join(overconfident)}. There the truth lies within the 95 % "
            f"ellipsoid of `{table.baseline}` in less than {100.0 * OVERCONFIDENT:.0f} % of the updates with every "
            "tested count, as Bailey, Nieto and Nebot (2006) say of filters of this kind."
        )
    return found


def page(summary: SweepSummary, study: Path) -> str:
    """What the script writes into docs/study.md."""
    table = summary.table
    v = tomllib.loads((study / "sweep.toml").read_text(encoding="utf-8"))["versions"]
    seconds = float(np.nansum(table.cube("cell_s")))
    pictures = "\n\n".join(
        f"### {drawing.title}\n![{drawing.title}](pictures/study_{drawing.name}.png)\n\n{drawing.caption}"
        for drawing in DRAWINGS
    )
    return f"""{table.ran.sum()} runs that took {seconds / 60.0:.0f} minutes of one core; code version {table.code},
Python {v["python"]}, numba {v["numba"]}.

{chr(10).join(f"- {sentence}" for sentence in sentences(summary))}

### How many are enough
{enough_table(summary)}

The rule is in [sweep.md](sweep.md#the-statistics).

{pictures}

### How often the truth lies within the filter's own 95 % ellipsoid
Of `{table.baseline}`, by particle count; median over the seeds.

{coverage_table(summary)}

### All figures
{markdown_table(summary)}"""


def main() -> None:
    """Write page and pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path, help="directory of the sweep")
    study = parser.parse_args().study
    summary = summarise(read_sweep(study))
    draw(summary)
    write_table(PAGE, "study", page(summary, study))


if __name__ == "__main__":
    main()
