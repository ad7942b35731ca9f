# SPDX-License-Identifier: MIT
"""Reads the tables of a sweep into arrays with axes (places, lines, counts, seeds); a place is a world or log."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from eval.report.verdict import OUTCOME_SENTENCES
from eval.sweep.look_schedule import looks_for
from eval.sweep.margin import Margin, parse_margin
from eval.sweep.measure import Measure
from eval.sweep.statistics import LEVEL

CURVE_GRID = np.linspace(0.02, 1.0, 50)
"""Shares of a run at which its curves are interpolated."""
CURVES = ("ess", "unique_ancestors", "nees")
_OLD_NAMES = {"founders": "unique_ancestors"}
"""Columns as versions up to 0.1 name them; they are still read."""
LEFT_OUT = "left out"
"""Status of runs that no answer rests on yet, in memory only."""
GIVEN_UP = "given up"
"""Status of jobs that would hardly help to find an answer that is open."""
WHOLE_ROUTE = 0.9
"""A run whose path is at least this share of its route drove all of it."""
_NAMES_OF_RUNS = ("key", "place", "line", "particles", "seed", "family")
"""Columns that say which run it is."""
_TIMINGS = ("filter_s", "cell_s", "wall_s", "cpu_s")


class SweepTableError(ValueError):
    """The tables cannot be read. The message names the file and what was expected."""


@dataclass(frozen=True)
class MarginChange:
    """Another margin was chosen when results were there already."""

    before: str
    """The margin until then, as `--margin` has it; empty = the default."""
    margin: str
    """The margin from then on."""
    seeds: int
    """How many seeds the answers rested on then."""


@dataclass(frozen=True, eq=False, repr=False)
class SweepTable:
    """All runs of a sweep. Arrays have the shape (places, lines, counts, seeds), NaN if a run lacks the figure."""

    title: str
    measure: Measure
    """The measure of accuracy."""
    baseline: str
    """Name of the line with which the others are compared."""
    code: str
    """Code version: a hash of the source files."""
    commit: str
    """Commit of the code, or name and version of the package; empty in tables of versions up to 0.1."""
    places: tuple[str, ...]
    lines: tuple[str, ...]
    counts: tuple[int, ...]
    seeds: tuple[int, ...]
    families: tuple[str | None, ...]
    """The kind of building that each place is a sample of, such as `rooms`; None for single worlds and logs."""
    until: str
    """When seeds are no longer added: "decided" or "smallest", as `--until` has it; empty = all are computed."""
    level: float
    """Confidence level of the decisions: higher than 0.95 where the sweep was looked at several times."""
    margin: Margin
    """How much larger an error may be than that of the largest count before it matters."""
    margin_changes: tuple[MarginChange, ...]
    """When another margin was chosen after results had been seen."""
    recorded: bool
    """Whether the places are recorded logs."""
    left: tuple[str, ...]
    """Places that the user gave up (`--give-up`), whose answers may be open for that reason only."""
    command: str
    """The command that repeats the sweep."""
    conditions: str
    """Robot, lidar, odometry and other settings of all runs, in words; empty in tables of versions up to 0.1."""
    columns: dict[str, NDArray[Any]]
    """Arrays by column; texts are objects, None if there is none."""
    curves: dict[str, NDArray[np.float64]]
    """Arrays with `CURVE_GRID` as fifth axis, by the names in `CURVES`."""

    def __repr__(self) -> str:
        """One line, for notebooks: the arrays printed whole fill pages."""
        sizes = zip(("places", "lines", "counts", "seeds"), self.shape, strict=True)
        axes = ", ".join(f"{size} {name if size != 1 else name[:-1]}" for name, size in sizes)
        return f"<SweepTable of {self.measure.key}: {axes}; {int(self.ran.sum())} of {self.ran.size} runs>"

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape of the arrays."""
        return len(self.places), len(self.lines), len(self.counts), len(self.seeds)

    def cube(self, name: str) -> NDArray[np.float64]:
        """A column of numbers; all NaN if the table has no such column."""
        if name not in self.columns:
            return np.full(self.shape, np.nan)
        return np.asarray(self.columns[name], dtype=np.float64)

    @cached_property
    def error(self) -> NDArray[np.float64]:
        """The measure of each run."""
        return self.cube(self.measure.key)

    @cached_property
    def refined(self) -> NDArray[np.float64]:
        """The measure of each run after the final pass; NaN for runs without one."""
        key = self.measure.refined_key
        if key is None:
            return np.full(self.shape, np.nan)
        return np.where(self.cube("refined") == 1.0, self.cube(key), np.nan)

    @cached_property
    def ran(self) -> NDArray[np.bool_]:
        """Whether each cell was computed, with or without a result."""
        computed: NDArray[np.bool_] = np.isin(self.columns["status"].astype(str), ("done", "failed"))
        return computed

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each run failed: the measured estimate has a bad outcome (`eval.report.verdict`), or no result."""
        bad = [outcome for outcome, (_, severity) in OUTCOME_SENTENCES.items() if severity == "bad"]
        unknown = np.full(self.shape, None, dtype=object)
        outcome = self.columns.get(self.measure.outcome, self.columns.get("outcome", unknown)).astype(str)
        wrong: NDArray[np.bool_] = np.isin(outcome, bad) | (self.columns["status"].astype(str) == "failed")
        return wrong

    @cached_property
    def failures(self) -> NDArray[np.float64]:
        """1 for each run that failed, 0 for the others, NaN where none was computed."""
        return np.where(self.ran, self.failed.astype(np.float64), np.nan)

    def routes(self, places: Iterable[int], line: int) -> int:
        """How many routes the computed runs of one line in these places drove: with fixed routes one per place."""
        unknown = np.full(self.shape, None, dtype=object)
        is_random = np.isin(self.columns.get("setting.route", unknown).astype(str), ("random", "stops"))
        seeds_that_ran = self.ran[:, line].any(axis=1).sum(axis=-1)
        return sum(int(seeds_that_ran[p] if is_random[p, line].any() else min(seeds_that_ran[p], 1)) for p in places)

    @cached_property
    def driven_share(self) -> tuple[float, float] | None:
        """The smallest and the largest share of its route that a run drove, if most runs drove less than `WHOLE_ROUTE`
        because their duration cut them short; None otherwise, and for logs."""
        shares = np.where(self.ran, self.cube("trajectory_filter.length_m") / self.cube("features.route_m"), np.nan)
        known = shares[np.isfinite(shares)]
        if not known.size or float(np.median(known)) >= WHOLE_ROUTE:
            return None
        return float(known.min()), float(known.max())

    @property
    def is_sequential(self) -> bool:
        """Whether the results are looked at several times (`--until decided`)."""
        return self.level > LEVEL

    @property
    def looks(self) -> tuple[int, ...]:
        """After how many seeds the results are looked at; empty for a sweep that is not sequential."""
        return looks_for(len(self.seeds)) if self.is_sequential else ()

    def seeds_of(self, place: int) -> int:
        """How many seeds of a place were computed."""
        return int(self.ran[place].any(axis=(0, 1)).sum())

    def judged(self) -> SweepTable:
        """The table with the runs that answers rest on: seeds of which every count was computed; where the results are
        looked at several times, those up to the last complete look.

        Runs of other seeds would compare different drives, or be a look that was not planned. They are as if they were
        not computed. Worlds in which no seed is complete keep all of their runs.
        """
        keeps = np.zeros(self.shape, dtype=np.bool_)
        for p, k in np.ndindex(*self.shape[:2]):
            keeps[p, k] = judged_seeds(np.all(self.ran[p, k], axis=0), is_sequential=self.is_sequential)
        return self._without(self.ran & ~keeps)

    def with_final_pass(self) -> SweepTable:
        """The table with the runs that ended with the final pass; the others are as if they were not computed.

        In a sweep that asked for another measure most counts have none: compared by a measure of the final estimate,
        they would be judged by the filter's path. A line without any final pass was meant so and is kept.
        """
        is_refined = self.cube("refined") == 1.0
        has_any = is_refined.any(axis=(0, 2, 3), keepdims=True)
        return self._without(self.ran & has_any & ~is_refined)

    def _without(self, left_out: NDArray[np.bool_]) -> SweepTable:
        """The table as if these runs, (places, lines, counts, seeds), were not computed."""
        if not left_out.any():
            return self
        columns = {name: cube.copy() for name, cube in self.columns.items()}
        for name, cube in columns.items():
            if name not in _NAMES_OF_RUNS and not name.startswith("setting."):
                cube[left_out] = None if cube.dtype == object else np.nan
        columns["status"][left_out] = LEFT_OUT
        curves = {name: np.where(left_out[..., None], np.nan, cube) for name, cube in self.curves.items()}
        return replace(self, columns=columns, curves=curves)

    def given_up(self, places: Iterable[str], line: str) -> bool:
        """Whether the sweep adds no more seeds in these places although the answer is open."""
        rows = [self.places.index(place) for place in places]
        return bool((self.columns["status"][rows, self.lines.index(line)].astype(str) == GIVEN_UP).any())

    @property
    def margin_words(self) -> str:
        """The margin in words."""
        return self.margin.words(is_length=self.measure.key.endswith("_m"))

    def family_names(self) -> list[str]:
        """Kinds of buildings of which there are several worlds."""
        names = [family for family in self.families if family is not None]
        return [name for name in dict.fromkeys(names) if names.count(name) > 1]


def judged_seeds(complete: NDArray[np.bool_], *, is_sequential: bool) -> NDArray[np.bool_]:
    """Which seeds the answers rest on, of those of which every count was computed, (seeds,); see `SweepTable.judged`.

    is_sequential: whether the results are looked at several times. Where no seed is complete all of them count.
    """
    if not complete.any():
        return np.ones_like(complete)
    if not is_sequential:
        return complete
    first = int(np.argmin(complete)) if not complete.all() else len(complete)
    looked = [look for look in looks_for(len(complete)) if look <= first]
    kept = complete.copy()
    kept[looked[-1] if looked else first :] = False
    return kept


def read_sweep(directory: str | os.PathLike[str]) -> SweepTable:
    """Read `sweep.parquet`, `curves.parquet` and `timings.parquet`; raises SweepTableError for other files."""
    folder = Path(directory)
    return _sweep_table(*(_read(folder / f"{name}.parquet") for name in ("sweep", "curves", "timings")))


def sweep_table(runs: pa.Table, curves: pa.Table, timings: pa.Table) -> SweepTable:
    """The sweep of three tables in memory, with the columns and the metadata of those files."""
    return _sweep_table(*(_content(table) for table in (runs, curves, timings)))


_Content = tuple[dict[str, NDArray[Any]], dict[str, Any]]
"""Columns of a table, and its metadata about the sweep."""


def _sweep_table(of_runs: _Content, of_curves: _Content, of_timings: _Content) -> SweepTable:
    (runs, about), (curves, _), (timings, _) = of_runs, of_curves, of_timings
    axes = [_levels(runs[name]) for name in ("place", "line", "particles", "seed")]
    where = tuple(
        np.array([{v: i for i, v in enumerate(levels)}[value] for value in runs[name].tolist()], dtype=np.intp)
        for name, levels in zip(("place", "line", "particles", "seed"), axes, strict=True)
    )
    shape = tuple(map(len, axes))
    row_of = {key: row for row, key in enumerate(runs["key"].tolist())}
    curves = {
        _OLD_NAMES.get(name, name): values for name, values in curves.items() if _OLD_NAMES.get(name) not in curves
    }
    columns = {name: _cube(values, where, shape) for name, values in runs.items()}
    if len(timings):
        rows = np.array([row_of[key] for key in timings["key"].tolist()], dtype=np.intp)
        at = tuple(index[rows] for index in where)
        columns |= {name: _cube(timings[name], at, shape) for name in _TIMINGS if name in timings}
    return SweepTable(
        title=about["title"],
        measure=Measure(about["measure"]),
        baseline=about["baseline"],
        code=about["code"],
        commit=str(about.get("commit", "")),
        places=tuple(axes[0]),
        lines=tuple(axes[1]),
        counts=tuple(axes[2]),
        seeds=tuple(axes[3]),
        families=_families(runs, axes[0]),
        until=str(about.get("until", "")),
        level=float(about.get("level", LEVEL)),
        margin=parse_margin(str(about.get("margin", ""))),
        margin_changes=tuple(MarginChange(**change) for change in about.get("margin_changes", ())),
        recorded=bool(about.get("recorded", False)),
        left=tuple(about.get("give_up", ())),
        command=str(about.get("command", "")),
        conditions=str(about.get("conditions", "")),
        columns=columns,
        curves=_curves(curves, row_of, where, shape),
    )


def _families(runs: dict[str, NDArray[Any]], places: list[Any]) -> tuple[str | None, ...]:
    """The family of each place; tables of versions up to 0.1 have none."""
    if "family" not in runs:
        return (None,) * len(places)
    of_place = dict(zip(runs["place"].tolist(), runs["family"].tolist(), strict=True))
    return tuple(of_place[place] for place in places)


def _read(path: Path) -> _Content:
    try:
        with path.open("rb") as file:
            return _content(pq.read_table(file))
    except FileNotFoundError:
        raise SweepTableError(f"{path}: no such file, expected what `testbed gather` writes") from None
    except (pa.ArrowInvalid, KeyError, ValueError) as error:
        raise SweepTableError(f"{path}: {error}: expected a table of a sweep") from None


def _content(table: pa.Table) -> _Content:
    about = json.loads((table.schema.metadata or {})[b"sweep"])
    return {name: _array(table.column(name)) for name in table.column_names}, about


def _array(column: Any) -> NDArray[Any]:
    """Numbers and booleans as floats (unknown = NaN), texts as objects."""
    if pa.types.is_string(column.type) or pa.types.is_null(column.type):
        return np.array(column.to_pylist(), dtype=object)
    if pa.types.is_integer(column.type) and column.null_count == 0:
        return np.asarray(column.to_numpy(), dtype=np.int64)
    values: NDArray[np.float64] = column.cast(pa.float64()).to_numpy()
    return values


def _levels(values: NDArray[Any]) -> list[Any]:
    """Distinct values in the order of their first occurrence."""
    return list(dict.fromkeys(values.tolist()))


def _cube(values: NDArray[Any], where: tuple[NDArray[np.intp], ...], shape: tuple[int, ...]) -> NDArray[Any]:
    words = values.dtype == object
    cube: NDArray[Any] = np.full(shape, None if words else np.nan, dtype=object if words else np.float64)
    cube[where] = values
    return cube


def _curves(
    table: dict[str, NDArray[Any]],
    row_of: dict[str, int],
    where: tuple[NDArray[np.intp], ...],
    shape: tuple[int, ...],
) -> dict[str, NDArray[np.float64]]:
    cubes = {name: np.full((*shape, len(CURVE_GRID)), np.nan) for name in CURVES}
    keys: Sequence[str] = table["key"].tolist() if table else []
    starts = [0, *(k for k in range(1, len(keys)) if keys[k] != keys[k - 1]), len(keys)] if keys else [0]
    for start, end in pairwise(starts):
        row = row_of[keys[start]]
        at = tuple(int(index[row]) for index in where)
        for name in CURVES:
            values = np.asarray(table[name][start:end], dtype=np.float64)
            cubes[name][at] = np.interp(CURVE_GRID, table["share"][start:end].astype(np.float64), values)
    return cubes
