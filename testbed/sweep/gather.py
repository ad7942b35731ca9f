# SPDX-License-Identifier: MIT
"""Makes the tables of a sweep from its cells: sweep.parquet (one row per cell), curves.parquet, timings.parquet.

`sweep.parquet` and `curves.parquet` hold nothing that depends on the machine's speed or on the order of the cells: the
same sweep gives the same bytes however it was carried out. Times are in `timings.parquet`, joined by `key`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eval.files.atomic_write import atomic_write
from eval.report.page import flat
from eval.sweep.results import SweepTable, judged_seeds, sweep_table
from eval.sweep.statistics import LEVEL
from testbed.sweep.column_words import described
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.command import command_of
from testbed.sweep.spec.conditions import conditions
from testbed.sweep.store import SweepDirectory
from worlds import family

if TYPE_CHECKING:
    import pyarrow as pa

_TEXTS = ("family", "reason")
"""Columns of texts that may all be null."""
TABLES = ("sweep.parquet", "curves.parquet", "timings.parquet")


@dataclass(frozen=True)
class Gathered:
    """How many cells of a sweep have a result."""

    done: int
    failed: tuple[tuple[Cell, str], ...]
    """Cells without a result, with the reason."""
    missing: tuple[Cell, ...]
    """Cells that were not computed yet."""

    @property
    def complete(self) -> bool:
        """Whether every cell has a result."""
        return not self.failed and not self.missing


@dataclass(frozen=True, eq=False)
class Collected:
    """What the cells of a sweep hold, as rows of the tables."""

    directory: SweepDirectory
    cells: tuple[Cell, ...]
    """In the order of the tables."""
    rows: tuple[dict[str, Any], ...]
    """Of `sweep.parquet`, one per cell; cells that were not computed are missing."""
    curves: tuple[dict[str, Any], ...]
    timings: tuple[dict[str, Any], ...]

    def table(self) -> SweepTable:
        """The sweep as the evaluation reads it."""
        about = _about(self.directory)
        return sweep_table(*(_arrow(rows, about) for rows in (self.rows, self.curves, self.timings)))

    def write(self, absent: Mapping[str, str] | None = None) -> Gathered:
        """Write the tables and return what is there and what is missing; absent: as in `gather`."""
        rows = [row | {"status": _status(row, absent)} for row in self.rows]
        for name, content in zip(TABLES, (rows, self.curves, self.timings), strict=True):
            with atomic_write(self.directory.path / name) as temporary:
                _write(temporary, _arrow(content, _about(self.directory)))
        of_cells = list(zip(self.cells, rows, strict=True))
        failed = tuple((cell, str(row["reason"])) for cell, row in of_cells if row["status"] == "failed")
        missing = tuple(cell for cell, row in of_cells if row["status"] == "missing")
        return Gathered(len(self.timings), failed, missing)


def gather(directory: SweepDirectory, absent: Mapping[str, str] | None = None) -> Gathered:
    """Write the tables of a sweep and return what is there and what is missing. Raises SweepError for damaged cells.

    absent: status of the cells that have neither result nor reason, by key (`testbed.sweep.looks.statuses`); None = all
    of them are missing.
    """
    return collect(directory).write(absent)


def collect(directory: SweepDirectory) -> Collected:
    """Read what is there of all cells of a sweep. Raises SweepError for damaged cells."""
    rows: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    timings: list[dict[str, Any]] = []
    cells = tuple(directory.cells())
    for cell in cells:
        key = cell.key
        result = directory.result(key)
        reason = directory.reason(key) if result is None else None
        status = "done" if result is not None else "failed" if reason is not None else "missing"
        rows.append(_row(cell, key, result, {"status": status, "reason": reason, "key": key, "in_report": False}))
        if result is not None:
            curves += _curve_rows(key, result)
            timings.append({"key": key} | result.timing)
    _mark_rows_of_report(rows, is_sequential=directory.manifest.spec.level > LEVEL)
    return Collected(directory, cells, tuple(rows), tuple(curves), tuple(timings))


def _mark_rows_of_report(rows: Sequence[dict[str, Any]], *, is_sequential: bool) -> None:
    """Set `in_report` of the runs on which the answers rest, see `eval.sweep.results.SweepTable.judged`."""
    groups: dict[tuple[str, str], dict[int, list[dict[str, Any]]]] = {}
    for row in rows:
        groups.setdefault((row["place"], row["line"]), {}).setdefault(row["seed"], []).append(row)
    for of_seeds in groups.values():
        complete = np.array([all(row["status"] != "missing" for row in of_seed) for of_seed in of_seeds.values()])
        kept = judged_seeds(complete, is_sequential=is_sequential)
        for of_seed, is_kept in zip(of_seeds.values(), kept.tolist(), strict=True):
            for row in of_seed:
                row["in_report"] = is_kept and row["status"] != "missing"


def _status(row: Mapping[str, Any], absent: Mapping[str, str] | None) -> str:
    if row["status"] != "missing" or absent is None:
        return str(row["status"])
    return absent[row["key"]]


def _about(directory: SweepDirectory) -> dict[str, Any]:
    """Facts about the sweep, the metadata of its tables."""
    manifest, spec = directory.manifest, directory.manifest.spec
    return {
        "title": spec.title,
        "measure": spec.key_measure,
        "baseline": spec.baseline or spec.lines()[0].name,
        "code": manifest.code,
        "commit": manifest.commit,
        "command": command_of(spec),
        "until": spec.until,
        "level": spec.level,
        "margin": spec.margin,
        "margin_changes": [asdict(change) for change in manifest.margin_changes],
        "conditions": conditions(spec),
        "recorded": bool(spec.logs),
        "give_up": list(spec.give_up),
    }


def _curve_rows(key: str, result: CellResult) -> list[dict[str, Any]]:
    """Rows of `curves.parquet`; `founders` repeats `unique_ancestors` for readers of versions up to 0.1."""
    columns = {"unique_ancestors" if name == "founders" else name: values for name, values in result.curves.items()}
    columns["founders"] = columns["unique_ancestors"]
    return [{"key": key} | {n: values[k] for n, values in columns.items()} for k in range(len(columns["share"]))]


def _row(cell: Cell, key: str, result: CellResult | None, state: Mapping[str, Any]) -> dict[str, Any]:
    """One row of `sweep.parquet`; measures that are lists are left out. state: the columns status, reason, key."""
    measures = {} if result is None else {k: v for k, v in flat(result.metrics) if not isinstance(v, list)}
    own = {
        "place": cell.place,
        "family": family(str(cell.source.get("world", ""))),
        "line": cell.line,
        "particles": cell.particles,
        "seed": cell.seed,
    }
    settings = {f"setting.{name}": value for name, value in cell.settings.items()}
    return own | dict(state) | settings | {name: value for name, value in measures.items() if name not in own}


def _arrow(rows: Sequence[Mapping[str, Any]], about: Mapping[str, Any]) -> pa.Table:
    """A table of rows: columns in the order of their first occurrence, facts about the sweep as metadata."""
    import pyarrow as pa

    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: [row.get(name) for row in rows] for name in names}
    arrays = {name: _array(values, is_text=name in _TEXTS) for name, values in columns.items()}
    fields = [pa.field(name, array.type, metadata={"description": described(name)}) for name, array in arrays.items()]
    schema = pa.schema(fields, metadata={"sweep": json.dumps(about, sort_keys=True)})
    return pa.table(list(arrays.values()), schema=schema)


def _write(path: Path, table: pa.Table) -> None:
    import pyarrow.parquet as pq

    with path.open("wb") as file:  # by a path, the library refuses names that are no UTF-8
        pq.write_table(table, file)


def _array(values: Sequence[Any], *, is_text: bool) -> Any:
    """Return a column of one type: float if any value is a float, string if any value is a string or `is_text`."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    for kind, arrow in ((bool, pa.bool_()), (int, pa.int64()), (str, pa.string())):
        if kinds == {kind}:
            return pa.array(values, type=arrow)
    if kinds <= {int, float} and not is_text:
        return pa.array(values, type=pa.float64())
    return pa.array([None if value is None else str(value) for value in values], type=pa.string())
