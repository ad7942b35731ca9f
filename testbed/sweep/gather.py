# SPDX-License-Identifier: MIT
"""From the directory of a sweep to tables: sweep.parquet (one row per cell), curves.parquet, timings.parquet.

`sweep.parquet` and `curves.parquet` hold nothing that depends on the machine's speed or on the order of the cells: the
same sweep gives the same bytes however it was carried out. Times are in `timings.parquet`, joined by `key`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eval.files.atomic_write import atomic_write
from eval.report.run_report import flat
from testbed.sweep.execution.compute import CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.store import SweepDirectory

TABLES = ("sweep.parquet", "curves.parquet", "timings.parquet")


@dataclass(frozen=True)
class Gathered:
    """What a sweep has come to."""

    done: int
    failed: tuple[tuple[Cell, str], ...]
    """Cells without a result, and why."""
    missing: tuple[Cell, ...]
    """Cells that nobody has computed yet."""

    @property
    def complete(self) -> bool:
        """Whether every cell has a result."""
        return not self.failed and not self.missing


def gather(directory: SweepDirectory) -> Gathered:
    """Write the tables of a sweep from its cells, and tell what is not there. Raises SweepError for damaged cells."""
    rows: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    timings: list[dict[str, Any]] = []
    failed: list[tuple[Cell, str]] = []
    missing: list[Cell] = []
    for cell in directory.manifest.cells():
        key = cell.key
        result = directory.result(key)
        reason = directory.reason(key) if result is None else None
        rows.append(_row(cell, key, result, reason))
        if result is not None:
            points = len(result.curves["share"])
            curves += [{"key": key} | {n: c[k] for n, c in result.curves.items()} for k in range(points)]
            timings.append({"key": key} | result.timing)
        elif reason is not None:
            failed.append((cell, reason))
        else:
            missing.append(cell)
    spec = directory.manifest.spec
    about = {
        "title": spec.title,
        "measure": spec.key_measure,
        "baseline": spec.baseline or spec.lines()[0].name,
        "code": directory.manifest.code,
    }
    for name, table in zip(TABLES, (rows, curves, timings), strict=True):
        _write(directory.path / name, table, about)
    return Gathered(len(timings), tuple(failed), tuple(missing))


def _row(cell: Cell, key: str, result: CellResult | None, reason: str | None) -> dict[str, Any]:
    """One row of `sweep.parquet`; measures that are lists are left out."""
    status = "done" if result is not None else "failed" if reason is not None else "missing"
    measures = {} if result is None else {k: v for k, v in flat(result.metrics) if not isinstance(v, list)}
    own = {"place": cell.place, "line": cell.line, "particles": cell.particles, "seed": cell.seed}
    state = {"status": status, "reason": reason, "key": key}
    settings = {f"setting.{name}": value for name, value in cell.settings.items()}
    return own | state | settings | {name: value for name, value in measures.items() if name not in own}


def _write(path: Path, rows: Sequence[Mapping[str, Any]], about: Mapping[str, Any]) -> None:
    """Rows as parquet, columns in the order in which they first occur, what the sweep is about in the metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: [row.get(name) for row in rows] for name in names}
    arrays = {name: _array(values) for name, values in columns.items()}
    table = pa.table(arrays).replace_schema_metadata({"sweep": json.dumps(about, sort_keys=True)})
    with atomic_write(path) as aside:
        pq.write_table(table, aside)


def _array(values: Sequence[Any]) -> Any:
    """A column: what is whole in some cells only is a float in all, what is a word in some is a word in all."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    for kind, arrow in ((bool, pa.bool_()), (int, pa.int64()), (str, pa.string())):
        if kinds == {kind}:
            return pa.array(values, type=arrow)
    if kinds <= {int, float}:
        return pa.array(values, type=pa.float64())
    return pa.array([None if value is None else str(value) for value in values], type=pa.string())
