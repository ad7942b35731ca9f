# SPDX-License-Identifier: MIT
"""The page of a sweep over SLAM systems: error, failures and cost of each, paired by seed with the first one.

The estimate that a system gives out may rest on scans that came later, such as after a final pass; what it said while
driving has a column of its own."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from eval.report import plots
from eval.report.comparison_plots import colour_of
from eval.report.page import Plot, render
from eval.sweep.measure import Unit
from eval.sweep.results import SweepTable, read_sweep
from eval.sweep.statistics import Interval, min_values, wilson_interval
from eval.sweep.summary import Group, SweepSummary, summarise


@dataclass(frozen=True)
class PlaceTable:
    """The systems in one world or log, or their failures in all of them."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    """Texts under the headings."""


def write_systems_page(directory: str | os.PathLike[str]) -> Path:
    """Write `sweep.html` and `table.md` into a sweep's directory and return the path of the page.

    Raises SweepTableError for damaged tables.
    """
    folder = Path(directory)
    summary = summarise(read_sweep(folder).judged())
    tables = place_tables(summary)
    page = render(
        "systems.html.j2",
        title=summary.table.title or "Sweep over SLAM systems",
        about=_about(summary),
        conditions=summary.table.conditions,
        command=summary.table.command,
        tables=tables,
        failures=failed_runs(summary.table),
        pictures=list(_pictures(summary)),
    )
    for name, text in {"sweep.html": page, "table.md": _markdown(tables)}.items():
        with atomic_write(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return folder / "sweep.html"


def place_tables(summary: SweepSummary) -> list[PlaceTable]:
    """Return a table for each world or log, and at the end one of the failures in all of them if there are several."""
    table = summary.table
    headings = ("system", "failed runs", "error, median", *_online_heading(table))
    headings += (f"minus {table.baseline}, paired", "time per scan [ms]")
    found = [
        PlaceTable(place, headings, tuple(_row(summary, p, k) for k in range(len(table.lines))))
        for p, place in enumerate(table.places)
    ]
    if len(table.places) > 1:
        pooled = tuple(_pooled(table, k, line) for k, line in enumerate(table.lines))
        found.append(PlaceTable("all places", headings[:2], pooled))
    return found


def _row(summary: SweepSummary, p: int, k: int) -> tuple[str, ...]:
    """Texts of one system in one place."""
    table, unit = summary.table, summary.unit
    group, cost = summary.group(table.places[p], table.lines[k], table.counts[0]), _milliseconds(table, p, k)
    online: tuple[str, ...] = ()
    if table.measure.online_key is not None:
        errors = table.cube(table.measure.online_key)[p, k, 0]
        known = errors[np.isfinite(errors)]
        online = (f"{unit.text(float(np.median(known)))} {unit.name}".strip() if len(known) else "–",)
    return (
        table.lines[k],
        failures_text(group.failures, group.runs),
        _error_text(table.error[p, k, 0], group.median, unit)
        + (", all failed" if group.failures == group.runs else ""),
        *online,
        _difference_text(group, unit, table.level),
        "–" if np.isnan(cost) else f"{cost:.2f}",
    )


def _online_heading(table: SweepTable) -> tuple[str, ...]:
    """The heading of what was known while driving, where another estimate is measured."""
    return () if table.measure.online_key is None else ("while driving",)


def failures_text(failures: int, runs: int) -> str:
    """Failed runs of all runs, with the rates that are compatible with them (95 % Wilson interval)."""
    low, high = wilson_interval(failures, runs)
    return f"{failures} of {runs}" + ("" if runs == 0 else f" ({low:.0%} to {high:.0%})")


def _pooled(table: SweepTable, k: int, line: str) -> tuple[str, ...]:
    """Failures in all places; errors of different places are not pooled."""
    failures, runs = int(table.failed[:, k].sum()), int(table.ran[:, k].sum())
    return line, failures_text(failures, runs)


def _milliseconds(table: SweepTable, p: int, k: int) -> float:
    """Median time of a system per scan [ms]; NaN if unknown."""
    costs = 1e3 * table.cube("wall_s")[p, k, 0] / table.cube("scans")[p, k, 0]
    known = costs[np.isfinite(costs)]
    return float(np.median(known)) if len(known) else np.nan


def _error_text(errors: NDArray[np.float64], median: Interval, unit: Unit) -> str:
    """The median of errors (seeds,) with its interval; with the range of the runs where they are too few for one."""
    if not np.isfinite(median.value):
        return "–"
    text = f"{unit.text(median.value)} {unit.name}".strip()
    if median.count == 1:
        return f"{text} (one run)"
    few = median.count < min_values()
    low, high = (np.nanmin(errors), np.nanmax(errors)) if few else (median.low, median.high)
    shown = f"{unit.text(float(low))} to {unit.text(float(high))}"
    return f"{text} (all {median.count} runs: {shown})" if few else f"{text} ({shown})"


def failed_runs(table: SweepTable) -> list[tuple[str, str, str, str]]:
    """Place, system, seeds and reason of the runs that failed, system by system; seeds with one reason are together."""
    outcomes = table.columns.get(table.measure.outcome, table.columns.get("outcome"))
    seeds: dict[tuple[str, str, str], list[str]] = {}
    for k, p, c, s in np.argwhere(table.failed.swapaxes(0, 1)):
        at = p, k, c, s
        stated = [None if column is None else column[at] for column in _reasons(table)]
        reason = next((str(text) for text in stated if text), "" if outcomes is None else f"ended {outcomes[at]}")
        seeds.setdefault((table.places[p], table.lines[k], reason), []).append(str(table.seeds[s]))
    return [(place, line, ", ".join(numbers), reason) for (place, line, reason), numbers in seeds.items()]


def _reasons(table: SweepTable) -> tuple[NDArray[np.object_] | None, ...]:
    """Why runs have no result, and why the outcome of others is a bad one."""
    return table.columns.get("reason"), table.columns.get(f"{table.measure.outcome}_reason")


def _difference_text(group: Group, unit: Unit, level: float) -> str:
    """Paired difference to the first system, and whether the seeds show it."""
    difference = group.to_baseline
    if difference is None:
        return "(the first system)"
    if not np.isfinite(difference.value):
        return "–"
    sign = "+" if difference.value > 0.0 else "-"
    text = f"{sign}{unit.text(abs(difference.value))} {unit.name}".strip()
    if difference.count < min_values(level):
        return f"{text}, {difference.count} pairs: too few to tell"
    if difference.contains(0.0):
        return f"{text}: no difference shown"
    return f"{text}: {'worse' if difference.value > 0.0 else 'better'}"


def _about(summary: SweepSummary) -> str:
    table = summary.table
    places = f"{len(table.places)} worlds or logs" if len(table.places) > 1 else table.places[0]
    return (
        f"{len(table.lines)} systems, {places}, {len(table.seeds)} seeds. Of one seed all systems see the same frames. "
        f"Measured is {table.measure.key}, {_estimate_words(table)}. Errors are medians over the seeds with 95 % "
        f"intervals, below {min_values()} runs with the range of the runs. The paired difference to "
        f"{table.baseline}, the system that was named first, is the median of the differences seed by seed, which need "
        "not be that of the two medians. A failed run ended lost, with broken loops, or without a result."
    )


def _estimate_words(table: SweepTable) -> str:
    """Which estimate is measured, and that systems differ in whether it rests on later scans."""
    if table.measure.online_key is None:
        return f"of {table.measure.estimate_is}"
    return (
        "of the path that a system gives out at the end. It may be made after a final pass over all scans, as that of "
        "gmapping is; without such a pass it is what the system said while driving, which has a column of its own"
    )


def _pictures(summary: SweepSummary) -> Iterator[Plot]:
    """The errors of all runs, and the median error against time, for each place."""
    table, unit = summary.table, summary.unit
    label = "error" + (f" [{unit.name}]" if unit.name else "")
    for p, place in enumerate(table.places):
        groups, dots = [], []
        for k, line in enumerate(table.lines):
            errors = unit.factor * table.error[p, k, 0]
            known = errors[np.isfinite(errors) & (errors > 0.0)]
            if len(known):
                groups.append((line, known, colour_of(k)))
                cost = _milliseconds(table, p, k)
                if cost > 0.0:
                    dots.append((line, cost, float(np.median(known)), colour_of(k)))
        if groups:
            yield Plot(f"Errors: {place}", plots.named_dots(groups, label), "A dot for each run; a bar at the median.")
        if len(dots) > 1:
            source = plots.labelled_dots(dots, "time per scan [ms]", label)
            yield Plot(f"Cost: {place}", source, "Median over the seeds. Left is cheaper, down is more accurate.")


def _markdown(tables: Sequence[PlaceTable]) -> str:
    lines = []
    for table in tables:
        lines += [f"**{table.title}**", "", f"| {' | '.join(table.headings)} |", f"|{'---|' * len(table.headings)}"]
        lines += [f"| {' | '.join(row)} |" for row in table.rows] + [""]
    return "\n".join(lines)
