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

from eval.sweep.paper_tables import enough_words, markdown_table
from eval.sweep.plots import style
from eval.sweep.report import DRAWINGS
from eval.sweep.results import read_sweep
from eval.sweep.summary import SweepSummary, summarise
from tools.pages import DOCS, write_table

PAGE = DOCS / "study.md"
OVERCONFIDENT = 0.8
"""A filter whose 95 % ellipsoid holds the truth less often than this is called over-confident."""


def draw(summary: SweepSummary) -> None:
    """All figures of the report as pictures."""
    for drawing in DRAWINGS:
        with style():
            drawing.draw(summary).savefig(DOCS / "pictures" / f"study_{drawing.name}.png", dpi=90)


def enough_table(summary: SweepSummary) -> str:
    """Particle counts beyond which more does not help."""
    table = summary.table
    rows = [["", *table.lines], ["---"] * (1 + len(table.lines))]
    for place in table.places:
        rows.append([place, *(enough_words(summary.enough(place, line), table.counts[-1]) for line in table.lines)])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def honesty_table(summary: SweepSummary) -> str:
    """How often the truth lies within the 95 % ellipsoid, of the baseline, by place and count."""
    table = summary.table
    rows = [["", *(str(count) for count in table.counts)], ["---"] * (1 + len(table.counts))]
    for place in table.places:
        shares = [summary.group(place, table.baseline, count).inside_share for count in table.counts]
        rows.append([place, *("–" if np.isnan(share) else f"{100.0 * share:.0f} %" for share in shares)])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def sentences(summary: SweepSummary) -> list[str]:
    """What the figures show, in words."""
    table = summary.table
    largest = table.counts[-1]
    told = []
    for line in table.lines:
        counts = {place: summary.enough(place, line) for place in table.places}
        known = [f"{place} {count}" for place, count in counts.items() if count is not None]
        open_ = [place for place, count in counts.items() if count is None]
        failed = sum(summary.group(place, line, largest).failures for place in table.places)
        runs = sum(summary.group(place, line, largest).runs for place in table.places)
        text = f"**{line}**: enough are " + ", ".join(known) if known else f"**{line}**: no count is shown to be enough"
        text += f"; not shown up to {largest}: {', '.join(open_)}" if known and open_ else ""
        told.append(f"{text}. With {largest} particles {failed} of {runs} runs failed.")
    sure = [
        place
        for place in table.places
        if all(summary.group(place, table.baseline, n).inside_share < OVERCONFIDENT for n in table.counts)
    ]
    if sure:
        told.append(
            f"Over-confident whatever the count: {', '.join(sure)}. There the truth lies within the 95 % ellipsoid of "
            f"`{table.baseline}` in less than {100.0 * OVERCONFIDENT:.0f} % of the updates with any number of "
            "particles that was tried, as Bailey, Nieto and Nebot (2006) say of filters of this kind."
        )
    return told


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

{honesty_table(summary)}

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
