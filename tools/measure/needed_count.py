# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Fit what decides the particle count to the designed experiment, and test the fit on worlds that are held out.

    testbed sweep --preset experiment --no-worst --out experiment
    testbed sweep --preset experiment-long --no-worst --out long
    testbed sweep --preset experiment-test --no-worst --out test
    python -m tools.measure.needed_count experiment long --test test

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
from eval.sweep.answer_words import particles
from eval.sweep.experiment import HeldOut, brier_score, joined, predict_held_out, predicted, runs_of
from eval.sweep.figures.layout import WIDTHS, style
from eval.sweep.needed_count import PREDICTORS, NeededCount, fit
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
    parser.add_argument(
        "--test",
        type=Path,
        help="directory of a part that is predicted from the others, before all are fitted together",
    )
    parser.add_argument("--print", action="store_true", help="print the tables and write nothing")
    arguments = parser.parse_args()
    tables = [read_sweep(directory) for directory in arguments.sweeps]
    tested = [] if arguments.test is None else predict_part(tables, read_sweep(arguments.test))
    if arguments.test is not None:
        tables.append(read_sweep(arguments.test))
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
    text = page(tables, model, runs.predictors, held_out, tested)
    if arguments.print:
        print(text)
        return
    with atomic_write(Path(needed_count.__file__).with_suffix(".json")) as temporary:
        temporary.write_text(json.dumps(model.document()) + "\n", encoding="utf-8")
    with style():
        draw(model, runs.predictors).savefig(PICTURE, dpi=140)
    write_table(PAGE, "needed", text)


def predict_part(tables: Sequence[SweepTable], test: SweepTable) -> list[HeldOut]:
    """Predict each world of a part from a fit to the other parts alone."""
    model = fit(joined([runs_of(table) for table in tables]), {})
    runs = joined([runs_of(test)])
    return [predicted(model, runs.of(runs.world == world), test.places[int(world)]) for world in np.unique(runs.world)]


def page(
    tables: Sequence[SweepTable],
    model: NeededCount,
    predictors: np.ndarray,
    held_out: list[HeldOut],
    tested: list[HeldOut],
) -> str:
    """The part of the page: growth of the needed count, levels of the design, held-out worlds.

    tested: the worlds of a part that was predicted before it was used.
    """
    facts = model.provenance
    parts = [
        f"{facts['runs']} runs of {facts['drives']} drives in {facts['worlds']} worlds; code version {facts['code']}. "
        f"The counts are compared with {model.max_count} particles.",
        "Median needed count for a low, a middle and a high value of one feature, with the other features at their "
        "medians; in brackets its 95 % interval; *worlds* is the range that holds for 95 % of single worlds. Last "
        "column: posterior probability that the high value needs more particles than the low one.",
        growth_table(model, predictors),
        "![How the needed count grows](pictures/needed_count.png)",
        f"Effects of worlds: standard deviation {model.holding_spread[0, 0]:.1f} on the log odds of holding, "
        f"{model.growth_spread[0, 0]:.2f} on the slope of the log error, whose mean is {model.growth[0, 0]:.2f}.",
        "Share of the runs that hold, by level of the design:",
        level_table(tables),
    ]
    if tested:
        parts += [
            "Worlds set aside, predicted by a fit to the other parts alone:",
            held_out_table(tested),
            f"Of these, {calibration(tested)}",
        ]
    parts.append(f"Each of all {len(held_out)} worlds, predicted by a fit to the others: {calibration(held_out)}")
    return "\n\n".join(parts)


def calibration(found: list[HeldOut]) -> str:
    """How often the ranges held what was observed, and how often that was to be expected."""
    own, constant = brier_score(found)
    number = len(found)
    within = [
        f"the {100 * share:.0f} % range in {sum(world.is_within(share) for world in found)} of {number} worlds "
        f"({sum(world.chance_within(share) for world in found):.1f} expected)"
        for share in (0.8, 0.95)
    ]
    return (
        f"what was needed lies within {within[0]}, within {within[1]}. The recommended count, rounded up to a tested "
        f"one, was too small in {sum(world.is_too_small for world in found)} "
        f"({sum(world.chance_too_small for world in found):.1f} expected). Mean squared error of the shares: "
        f"{own:.3f}; predicting each world by the mean of the others gives {constant:.3f}."
    )


def growth_table(model: NeededCount, predictors: np.ndarray) -> str:
    """The needed count at a low, middle and high value of each predictor, and whether it grows."""
    rows = [["feature", "low", "middle", "high", "more with high than with low"]]
    for k, predictor in enumerate(PREDICTORS):
        row, draws = [predictor.words], []
        for value in np.quantile(predictors[:, k], QUANTILES):
            at = model.centre.copy()
            at[k] = value
            draws.append(model.middle_in_draws(at))
            row.append(f"{predictor.text(float(value))}: {with_intervals(model, at, draws[-1])}")
        rows.append([*row, f"{100 * (draws[-1] > draws[0]).mean():.0f} %"])
    return markdown(rows)


def with_intervals(model: NeededCount, at: np.ndarray, draws: np.ndarray) -> str:
    """The median needed count, how well it is known, and what 95 % of such worlds need."""

    def text(count: float | None) -> str:
        return f"> {model.max_count}" if count is None or np.isinf(count) else f"{count:.0f}"

    ordered = np.sort(draws)
    known = [text(ordered[round(share * (len(ordered) - 1))]) for share in (0.025, 0.975)]
    worlds = [text(end) for end in model.interval(at)]
    return f"{text(model.needed(at))} [{', '.join(known)}], worlds {' to '.join(worlds)}"


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
    rows = [
        [
            "world",
            "drives",
            *(f"share of runs that hold with {particles(c)}: predicted / observed" for c in counts),
            "recommended count",
            "needed count: median, 80 % range / observed",
        ]
    ]

    def text(count: float) -> str:
        return f"{count:.0f}" if np.isfinite(count) else f"> {counts[-1]}"

    for world in held_out:
        shares = [f"{100 * p:.0f} / {100 * o:.0f} %" for p, o in zip(world.predicted, world.observed, strict=True)]
        middle, (low, high) = text(world.quantile(0.5)), map(text, world.range(0.8))
        reach = "" if low == high else f", {low} to {high}"
        needed = f"{middle}{reach} / {text(world.needed_observed)}"
        rows.append([_short(world.place), str(world.drives), *shares, text(world.start), needed])
    return markdown(rows)


def _short(place: str) -> str:
    """`blocks 18x14, 1 loop, clutter 0` for `blocks-size18x14-loops1-clutter0-30`."""
    kind, *arguments, _seed = place.split("-")
    words = [kind]
    for argument in arguments:
        name, value = argument.rstrip("0123456789.x"), argument.lstrip("abcdefghijklmnopqrstuvwxyz")
        if name == "size":
            words[0] += f" {value}"
        elif name == "loops":
            words.append(f"{value} loop{'' if value == '1' else 's'}")
        else:
            words.append(f"{name} {value}")
    return ", ".join(words)


def markdown(rows: list[list[str]]) -> str:
    """A table in Markdown; the first row is the head."""
    rows = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def draw(model: NeededCount, predictors: np.ndarray) -> Figure:
    """The needed count against the longest way through unknown floor, for three degrees to which scans determine the
    position; the band: 80 % of the worlds like that."""
    figure = Figure(figsize=(WIDTHS[1], 3.4), layout="constrained")
    ax: Any = figure.add_subplot()
    lengths = np.linspace(model.low[0], model.high[0], 40)
    for k, determined in enumerate(np.quantile(predictors[:, 2], QUANTILES)):
        at = np.tile(model.centre, (len(lengths), 1))
        at[:, 0], at[:, 2] = lengths, determined
        beyond = 1.6 * model.max_count
        middle = [model.needed(row) or beyond for row in at]
        ends = [[model.quantile(row, share) or beyond for share in (0.1, 0.9)] for row in at]
        colour = COLOURS[k % len(COLOURS)]
        ax.fill_between(2.0**lengths, *np.transpose(ends), color=colour, alpha=0.15, linewidth=0)
        ax.plot(
            2.0**lengths,
            middle,
            color=colour,
            label=PREDICTORS[2].text(float(determined)),
        )
    ax.axhline(model.max_count, color="grey", linewidth=0.8, linestyle="--")
    ax.set(xscale="log", yscale="log", xlabel=f"{PREDICTORS[0].words} [m]", ylabel="particles needed")
    ax.set_yticks([1, 2, 3, 5, 10, 20, 30, 1.6 * model.max_count])
    ax.set_yticklabels(["1", "2", "3", "5", "10", "20", "30", "more"])
    ax.minorticks_off()
    lengths_shown = [10, 20, 50, 100, 200, 400, 800]
    ax.set_xticks(lengths_shown, [str(length) for length in lengths_shown])
    ax.set_xlim(2.0 ** model.low[0], 2.0 ** model.high[0])
    figure.legend(frameon=False, loc="outside upper center", ncols=3, title="How well scans determine the position")
    return figure


if __name__ == "__main__":
    main()
