# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Fit what decides the particle count to the designed experiment, and test the fit on worlds that are held out.

    testbed sweep --preset experiment --no-worst --out experiment
    testbed sweep --preset experiment-long --no-worst --out long
    python -m tools.measure.needed_count experiment long

Writes: docs/study.md (needed), docs/pictures/needed_count.png

It also writes `eval/sweep/needed_count.json`, from which `testbed sweep --suggest` answers; `--print` writes nothing.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eval.files.atomic_write import atomic_write
from eval.report.comparison_plots import COLOURS
from eval.sweep import needed_count
from eval.sweep.answers import particles
from eval.sweep.experiment import HeldOut, brier_score, joined, predict_held_out, runs_of
from eval.sweep.needed_count import PREDICTORS, NeededCount, fit
from eval.sweep.plots import WIDTHS, style
from eval.sweep.results import SweepTable, read_sweep
from tools.pages import DOCS, write_table

PAGE = DOCS / "study.md"
PICTURE = DOCS / "pictures" / "needed_count.png"
LOOP_BOUNDS = (0.0, 30.0, 60.0, 120.0, 250.0, 500.0, np.inf)
"""Levels of the largest loop [m]."""
QUANTILES = (0.1, 0.5, 0.9)
"""Each predictor is shown at these quantiles of the experiment, the others at their medians."""


def main() -> None:
    """Fit, test, and write data, tables and picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sweeps", type=Path, nargs="+", help="directories of the parts; a part may be unfinished")
    parser.add_argument("--print", action="store_true", help="print the tables and write nothing")
    arguments = parser.parse_args()
    tables = [read_sweep(directory) for directory in arguments.sweeps]
    runs = joined([runs_of(table) for table in tables])
    provenance = {
        "command": "; ".join(table.command for table in tables),
        "code": ", ".join(dict.fromkeys(table.code for table in tables)),
        "runs": len(runs.world),
        "drives": len(np.unique(runs.drive)),
        "worlds": len(np.unique(runs.world)),
    }
    held_out = predict_held_out(runs, [place for table in tables for place in table.places])
    provenance["held_out"] = {"worlds": len(held_out), "too_small": sum(world.is_too_small for world in held_out)}
    model = fit(runs, provenance)
    text = page(tables, model, runs.predictors, held_out)
    if arguments.print:
        print(text)
        return
    with atomic_write(Path(needed_count.__file__).with_suffix(".json")) as temporary:
        temporary.write_text(json.dumps(model.document()) + "\n", encoding="utf-8")
    with style():
        draw(model, runs.predictors).savefig(PICTURE, dpi=140)
    write_table(PAGE, "needed", text)


def page(tables: Sequence[SweepTable], model: NeededCount, predictors: np.ndarray, held_out: list[HeldOut]) -> str:
    """The part of the page: growth of the needed count, levels of the design, held-out worlds."""
    own, constant = brier_score(held_out)
    facts = model.provenance
    same = sum(world.needed_predicted == world.needed_observed for world in held_out)
    parts = [
        f"{facts['runs']} runs of {facts['drives']} drives in {facts['worlds']} worlds; code version {facts['code']}. "
        f"The counts are compared with {model.max_count} particles.",
        "Needed count, with the other features at their medians (95 % interval, bootstrap over worlds):",
        growth_table(model, predictors),
        "![How the needed count grows](pictures/needed_count.png)",
        "Share of the runs that hold, by level of the design:",
        level_table(tables),
        "Held-out worlds: the model is fitted to the others and predicts the share of the runs that hold.",
        held_out_table(held_out),
        f"Mean squared error of these shares: {own:.3f}; predicting each world by the mean of the others gives "
        f"{constant:.3f}. The needed count is predicted exactly for {same} of {len(held_out)} worlds.",
    ]
    return "\n\n".join(parts)


def growth_table(model: NeededCount, predictors: np.ndarray) -> str:
    """The needed count at a low, middle and high value of each predictor."""
    rows = [["feature", "low", "middle", "high"]]
    for k, predictor in enumerate(PREDICTORS):
        row = [predictor.words]
        for value in np.quantile(predictors[:, k], QUANTILES):
            at = model.centre.copy()
            at[k] = value
            row.append(f"{predictor.text(float(value))}: {with_interval(model, at)}")
        rows.append(row)
    return markdown(rows)


def with_interval(model: NeededCount, at: np.ndarray) -> str:
    """The needed count with its interval, as text."""
    low, high = (f"> {model.max_count}" if end is None else str(end) for end in model.interval(at))
    count = model.needed(at)
    return f"{f'> {model.max_count}' if count is None else count} [{low}, {high}]"


def level_table(tables: Sequence[SweepTable]) -> str:
    """Share of the runs that hold, for each level of loops, clutter, odometry and lidar, by particle count."""
    counts = tables[0].counts
    rows = [["", *map(particles, counts), "runs each"]]
    masks = [_levels(table) for table in tables]
    for name in dict.fromkeys(name for levels in masks for name in levels):
        holds: list[list[np.ndarray]] = [[] for _ in counts]
        for table, levels in zip(tables, masks, strict=True):
            if name not in levels:
                continue
            complete = levels[name] & table.ran.all(axis=2, keepdims=True)
            for c in range(len(counts)):
                holds[c].append(~table.failed[:, :, c][complete[:, :, c]])
        pooled = [np.concatenate(runs) for runs in holds]
        if len(pooled[0]):
            rows.append([name, *(f"{100.0 * runs.mean():.0f} %" for runs in pooled), str(len(pooled[0]))])
    return markdown(rows)


def _levels(table: SweepTable) -> dict[str, np.ndarray]:
    """The runs (places, lines, counts, seeds) of each level of the design, by its name."""
    loop = np.nan_to_num(table.cube("features.largest_loop_m"))
    density = table.cube("features.clutter_per_10_m2")
    found = {}
    for low, high in itertools.pairwise(LOOP_BOUNDS):
        name = f"largest loop {low:.0f} to {high:.0f} m" if np.isfinite(high) else f"largest loop over {low:.0f} m"
        found[name] = (loop >= low) & (loop < high)
    found |= {"no clutter": density == 0.0, "clutter": density > 0.0}
    for word, column in (("odometry", "setting.odometry.grade"), ("lidar", "setting.lidar")):
        values = table.columns.get(column, np.full(table.shape, None))
        found |= {f"{word} {level}": values == level for level in dict.fromkeys(values.ravel().tolist()) if level}
    return found


def held_out_table(held_out: list[HeldOut]) -> str:
    """Predicted and observed, world by world."""
    counts = held_out[0].counts
    rows = [["world", "drives", *(f"{c}: predicted / observed" for c in counts), "needed: predicted / observed"]]
    for world in held_out:
        shares = [f"{100 * p:.0f} / {100 * o:.0f} %" for p, o in zip(world.predicted, world.observed, strict=True)]
        needed = [f"> {counts[-1]}" if n is None else str(n) for n in (world.needed_predicted, world.needed_observed)]
        rows.append([world.place, str(world.drives), *shares, " / ".join(needed)])
    return markdown(rows)


def markdown(rows: list[list[str]]) -> str:
    """A table in Markdown; the first row is the head."""
    rows = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def draw(model: NeededCount, predictors: np.ndarray) -> Figure:
    """The needed count against the longest way through unknown floor, for three errors of the odometry."""
    figure = Figure(figsize=(WIDTHS[1], 3.0), layout="constrained")
    ax: Any = figure.add_subplot()
    lengths = np.linspace(model.low[0], model.high[0], 40)
    for k, odometry in enumerate(np.quantile(predictors[:, 1], QUANTILES)):
        at = np.tile(model.centre, (len(lengths), 1))
        at[:, 0], at[:, 1] = lengths, odometry
        beyond = 1.6 * model.max_count
        middle = [model.needed(row) or beyond for row in at]
        ends = [[end or beyond for end in model.interval(row)] for row in at]
        colour = COLOURS[k % len(COLOURS)]
        ax.fill_between(2.0**lengths, *np.transpose(ends), color=colour, alpha=0.15, linewidth=0)
        ax.plot(2.0**lengths, middle, color=colour, label=f"odometry {PREDICTORS[1].text(float(odometry))} per m")
    ax.axhline(model.max_count, color="grey", linewidth=0.8, linestyle="--")
    ax.set(xscale="log", yscale="log", xlabel=f"{PREDICTORS[0].words} [m]", ylabel="particles needed")
    ax.set_yticks([1, 2, 3, 5, 10, 20, 30, 1.6 * model.max_count])
    ax.set_yticklabels(["1", "2", "3", "5", "10", "20", "30", "more"])
    ax.minorticks_off()
    lengths_shown = [10, 20, 50, 100, 200, 400, 800]
    ax.set_xticks(lengths_shown, [str(length) for length in lengths_shown])
    ax.set_xlim(2.0 ** model.low[0], 2.0 ** model.high[0])
    ax.legend(frameon=False, loc="upper left")
    return figure


if __name__ == "__main__":
    main()
