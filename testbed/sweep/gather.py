# SPDX-License-Identifier: MIT
"""Makes the tables of a sweep from its cells: sweep.parquet (one row per cell), curves.parquet, timings.parquet.

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
from eval.report.page import flat
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.command import command_of
from testbed.sweep.spec.conditions import conditions
from testbed.sweep.store import SweepDirectory
from worlds import family

DESCRIPTIONS = {
    "place": "name of the world or log",
    "family": "kind of building that the world is a sample of, such as rooms; null for single worlds and logs",
    "line": "name of the combination of settings",
    "particles": "particle count",
    "seed": "seed of the simulation and of the filter",
    "status": "done, failed (no result), missing (not computed yet), or with --until: later (needed if the next look "
    "leaves the answer open), not needed (the answer is known without it), given up (the answer is open, and it would "
    "hardly be found with it)",
    "reason": "why there is no result",
    "key": "hash of everything that decides the result; joins sweep, curves and timings",
    "share": "share of the updates that are done, 0 to 1",
    "ess": "effective sample size as a share of the particles",
    "unique_ancestors": "unique ancestors as a share of the particles",
    "founders": "the same as unique_ancestors, for readers of versions up to 0.1",
    "nees": "normalised estimation error squared",
    "cell_s": "time of the whole job [s]",
    "wall_s": "time of filter and final pass [s]",
    "filter_s": "time of the filter alone, without the final pass [s]",
    "realtime_factor": "duration of the drive by wall_s, so with the final pass; duration_s / filter_s is the filter's",
}
"""What the columns hold that are no settings (`setting.NAME`), features (`features.NAME`) or measures."""
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


def gather(directory: SweepDirectory, absent: Mapping[str, str] | None = None) -> Gathered:
    """Write the tables of a sweep and return what is there and what is missing. Raises SweepError for damaged cells.

    absent: status of the cells that have neither result nor reason, by key (`testbed.sweep.looks.statuses`); None = all
    of them are missing.
    """
    rows: list[dict[str, Any]] = []
    curves: list[dict[str, Any]] = []
    timings: list[dict[str, Any]] = []
    failed: list[tuple[Cell, str]] = []
    missing: list[Cell] = []
    for cell in directory.manifest.cells():
        key = cell.key
        result = directory.result(key)
        reason = directory.reason(key) if result is None else None
        without = "missing" if absent is None else absent[key]
        status = "done" if result is not None else "failed" if reason is not None else without
        rows.append(_row(cell, key, result, {"status": status, "reason": reason, "key": key}))
        if result is not None:
            curves += _curve_rows(key, result)
            timings.append({"key": key} | result.timing)
        elif reason is not None:
            failed.append((cell, reason))
        elif status == "missing":
            missing.append(cell)
    spec = directory.manifest.spec
    about = {
        "title": spec.title,
        "measure": spec.key_measure,
        "baseline": spec.baseline or spec.lines()[0].name,
        "code": directory.manifest.code,
        "command": command_of(spec),
        "level": spec.level,
        "margin": spec.margin,
        "conditions": conditions(spec),
        "recorded": bool(spec.logs),
    }
    for name, table in zip(TABLES, (rows, curves, timings), strict=True):
        _write(directory.path / name, table, about)
    return Gathered(len(timings), tuple(failed), tuple(missing))


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


def _write(path: Path, rows: Sequence[Mapping[str, Any]], about: Mapping[str, Any]) -> None:
    """Write rows as parquet: columns in the order of their first occurrence, facts about the sweep as metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: [row.get(name) for row in rows] for name in names}
    arrays = {name: _array(values) for name, values in columns.items()}
    fields = [pa.field(name, array.type, metadata=_description(name)) for name, array in arrays.items()]
    schema = pa.schema(fields, metadata={"sweep": json.dumps(about, sort_keys=True)})
    table = pa.table(list(arrays.values()), schema=schema)
    with atomic_write(path) as temporary:
        pq.write_table(table, temporary)


def _description(name: str) -> dict[str, str]:
    """Metadata of a column: what it holds."""
    head, _, rest = name.partition(".")
    if head == "setting":
        return {"description": f"setting {rest}; null = default"}
    if head == "features":
        return {"description": f"{rest.replace('_', ' ')}, a feature of world, route and sensors (docs/sweep.md)"}
    return {"description": DESCRIPTIONS.get(name, f"{name} of metrics.json (docs/metrics.md)")}


def _array(values: Sequence[Any]) -> Any:
    """Return a column of one type: float if any value is a float, string if any value is a string."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    for kind, arrow in ((bool, pa.bool_()), (int, pa.int64()), (str, pa.string())):
        if kinds == {kind}:
            return pa.array(values, type=arrow)
    if kinds <= {int, float}:
        return pa.array(values, type=pa.float64())
    return pa.array([None if value is None else str(value) for value in values], type=pa.string())
