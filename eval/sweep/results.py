# SPDX-License-Identifier: MIT
"""Reads the tables of a sweep into arrays with axes (places, lines, counts, seeds); a place is a world or log."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from eval.report.verdict import OUTCOME_SENTENCES

CURVE_GRID = np.linspace(0.02, 1.0, 50)
"""Shares of a run at which its curves are interpolated."""
CURVES = ("ess", "unique_ancestors", "nees")
_OLD_NAMES = {"founders": "unique_ancestors"}
"""Columns as versions up to 0.1 name them; they are still read."""
_TIMINGS = ("filter_s", "cell_s")


class SweepTableError(ValueError):
    """The tables cannot be read. The message names the file and what was expected."""


@dataclass(frozen=True, eq=False)
class SweepTable:
    """All runs of a sweep. Arrays have the shape (places, lines, counts, seeds), NaN if a run lacks the figure."""

    title: str
    measure: str
    """Key of the measure of accuracy; smaller is better."""
    baseline: str
    """Name of the line with which the others are compared."""
    code: str
    places: tuple[str, ...]
    lines: tuple[str, ...]
    counts: tuple[int, ...]
    seeds: tuple[int, ...]
    columns: dict[str, NDArray[Any]]
    """Arrays by column; texts are objects, None if there is none."""
    curves: dict[str, NDArray[np.float64]]
    """Arrays with `CURVE_GRID` as fifth axis, by the names in `CURVES`."""

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
        return self.cube(self.measure)

    @cached_property
    def ran(self) -> NDArray[np.bool_]:
        """Whether each cell was computed, with or without a result."""
        computed: NDArray[np.bool_] = np.isin(self.columns["status"].astype(str), ("done", "failed"))
        return computed

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each run failed: its outcome is bad by `eval.report.verdict`, or it has no result."""
        bad = [outcome for outcome, (_, severity) in OUTCOME_SENTENCES.items() if severity == "bad"]
        outcome = self.columns.get("outcome", np.full(self.shape, None, dtype=object)).astype(str)
        wrong: NDArray[np.bool_] = np.isin(outcome, bad) | (self.columns["status"].astype(str) == "failed")
        return wrong


def read_sweep(directory: str | os.PathLike[str]) -> SweepTable:
    """Read `sweep.parquet`, `curves.parquet` and `timings.parquet`; raises SweepTableError for other files."""
    folder = Path(directory)
    runs, about = _read(folder / "sweep.parquet")
    axes = [_levels(runs[name]) for name in ("place", "line", "particles", "seed")]
    where = tuple(
        np.array([{v: i for i, v in enumerate(levels)}[value] for value in runs[name].tolist()], dtype=np.intp)
        for name, levels in zip(("place", "line", "particles", "seed"), axes, strict=True)
    )
    shape = tuple(map(len, axes))
    row_of = {key: row for row, key in enumerate(runs["key"].tolist())}
    timings, _ = _read(folder / "timings.parquet")
    curves, _ = _read(folder / "curves.parquet")
    curves = {
        _OLD_NAMES.get(name, name): values for name, values in curves.items() if _OLD_NAMES.get(name) not in curves
    }
    columns = {name: _cube(values, where, shape) for name, values in runs.items()}
    if len(timings):
        rows = np.array([row_of[key] for key in timings["key"].tolist()], dtype=np.intp)
        at = tuple(index[rows] for index in where)
        columns |= {name: _cube(timings[name], at, shape) for name in _TIMINGS}
    return SweepTable(
        title=about["title"],
        measure=about["measure"],
        baseline=about["baseline"],
        code=about["code"],
        places=tuple(axes[0]),
        lines=tuple(axes[1]),
        counts=tuple(axes[2]),
        seeds=tuple(axes[3]),
        columns=columns,
        curves=_curves(curves, row_of, where, shape),
    )


def _read(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Columns of a table, and its metadata about the sweep."""
    try:
        table = pq.read_table(path)
        about = json.loads((table.schema.metadata or {})[b"sweep"])
    except FileNotFoundError:
        raise SweepTableError(f"{path}: no such file, expected what `testbed gather` writes") from None
    except (pa.ArrowInvalid, KeyError, ValueError) as error:
        raise SweepTableError(f"{path}: {error}: expected a table of a sweep") from None
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
