# SPDX-License-Identifier: MIT
"""The page of a stress test: what each system survives of each perturbation, as bars and as a table."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from eval.files.atomic_write import atomic_write
from eval.report.comparison_plots import colour_of
from eval.report.page import Plot, render
from eval.report.plots import STYLE, svg_uri
from eval.survival.results import UNPERTURBED, Run, Scale, fail_unperturbed, thresholds
from eval.survival.threshold import LEVEL, Threshold
from eval.sweep.systems_page import failures_text

PAGE = "report.html"
METHOD = (
    "A value is the one at which half of the runs fail: lost, with broken loops, without a result, or with hardly any "
    f"pose. It is the median of the posterior distribution of a logistic curve, with its {LEVEL:.0%} interval. Each "
    "run is made near the value as it is known by then (QUEST, Watson and Pelli 1983). The value holds for these "
    "drives: in other worlds and with other robots it is another one."
)


def write_stress_page(
    folder: str | os.PathLike[str], runs: Sequence[Run], scales: Mapping[str, Scale], *, about: str, command: str
) -> Path:
    """Write `report.html` and `table.md` and return the path of the page.

    scales: by perturbation, in the order of the page; about: what the runs were made on, a sentence; command: the one
    that makes them again
    """
    directory = Path(folder)
    found = thresholds(runs)
    names = [name for name in scales if any(run.perturbation == name for run in runs)]
    systems = list(dict.fromkeys(run.system for run in runs))
    rows = survival_rows(runs, {name: scales[name] for name in names})
    page = render(
        "stress.html.j2",
        title="Stress test",
        about=about,
        method=METHOD,
        command=command,
        headings=("perturbation", "unit", *systems),
        rows=rows,
        pictures=[
            Plot(
                f"What {system} survives",
                svg_uri(survival_bars({system: found}, {name: scales[name] for name in names})),
                "Bars: up to the value at which half of the runs fail. Lines: its interval.",
            )
            for system in systems
            if any(key[0] == system for key in found)
        ],
        failures=_reasons(runs),
    )
    headings = ("perturbation", "unit", *systems)
    lines = [f"| {' | '.join(headings)} |", f"|{'---|' * len(headings)}", *(f"| {' | '.join(row)} |" for row in rows)]
    for name, text in {PAGE: page, "table.md": "\n".join(lines) + "\n"}.items():
        with atomic_write(directory / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return directory / PAGE


def survival_rows(runs: Sequence[Run], scales: Mapping[str, Scale]) -> list[tuple[str, ...]]:
    """Rows of the table: perturbation, unit, and of each system the value that it survives, with its interval.

    The first row has the failures on the drives as they are.
    """
    found = thresholds(runs)
    systems = list(dict.fromkeys(run.system for run in runs))
    plain = [[run.has_failed for run in runs if (run.system, run.perturbation) == (s, UNPERTURBED)] for s in systems]
    rows = [("nothing", "failed runs", *(failures_text(sum(failed), len(failed)) for failed in plain))]
    hopeless = fail_unperturbed(runs)
    for name, scale in scales.items():
        cells = [
            "fails as they are" if system in hopeless else threshold_text(found.get((system, name)), scale)
            for system in systems
        ]
        rows.append((name, scale.unit, *cells))
    return rows


def threshold_text(threshold: Threshold | None, scale: Scale) -> str:
    """The value that a system survives, with its interval."""
    if threshold is None:
        return "–"
    return f"{scale.text(threshold.value)} ({scale.text(threshold.low)} to {scale.text(threshold.high)})"


def survival_bars(
    found: Mapping[str, Mapping[tuple[str, str], Threshold]], scales: Mapping[str, Scale], width: float = 7.6
) -> Figure:
    """Draw a bar for each perturbation and system, from harmless to the severity that is survived.

    found: thresholds by (system, perturbation), for each system that is drawn
    """
    systems, height = list(found), 0.8 / max(len(found), 1)
    with rc_context(STYLE):
        figure = Figure(figsize=(width, 0.9 + len(scales) * max(0.3, 0.2 * len(systems))))
        ax = figure.subplots()
        for number, system in enumerate(systems):
            for row, (name, scale) in enumerate(scales.items()):
                threshold = found[system].get((system, name))
                if threshold is None:
                    continue
                y = row + height * (number - 0.5 * (len(systems) - 1))
                low, value, high = np.clip((threshold.low, threshold.value, threshold.high), 0.0, 1.0)
                ax.barh(y, value, height=0.85 * height, color=colour_of(number), label=system if row == 0 else None)
                ax.plot([low, high], [y, y], color="#1b1f24", lw=1.2, solid_capstyle="butt")
                ax.text(1.02, y, f"{scale.text(threshold.value)} {scale.unit}", va="center", fontsize=8.0)
        ax.set_yticks(range(len(scales)), list(scales))
        ax.set(xlim=(0.0, 1.0), ylim=(len(scales) - 0.4, -0.6))
        ax.set_xticks([0.0, 1.0], ["harmless", "hopeless"])
        ax.grid(axis="y", visible=False)
        if len(systems) > 1:
            figure.legend(loc="outside upper center", ncols=len(systems))
        return figure


def _reasons(runs: Sequence[Run]) -> list[tuple[str, str, str, str]]:
    """How the runs of each system and perturbation ended: system, perturbation, outcomes, an example of a failure."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.system, run.perturbation), []).append(run)
    rows = []
    for (system, name), group in groups.items():
        counts = Counter(run.outcome for run in group).most_common()
        bad = next((run for run in group if run.has_failed), None)
        example = "" if bad is None else f"{bad.place}, seed {bad.seed}, {bad.value or 0.0:g}: {bad.reason}"
        rows.append((system, name, ", ".join(f"{count} {outcome}" for outcome, count in counts), example))
    return rows
