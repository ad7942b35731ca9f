# SPDX-License-Identifier: MIT
"""Recordings as Apache Parquet: a directory with one table, a row a frame, and a dataset card. Nothing is rounded.

`frames.parquet` is what pandas, polars, DuckDB and the Hugging Face hub read; the card (README.md) says what its
columns mean. Where the true map is known, the directory also holds it as a ROS map.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.files.map_server import read_map, write_map
from testbed.formats.checksums import verify
from testbed.formats.head import LogHead
from testbed.formats.log import Log, LogError, shortened
from testbed.formats.stamps import EXPECTED, NANOSECONDS_NOTE, column_in_seconds
from testbed.frame_table import BeamPattern, FrameTable, Integers
from testbed.large_arrays import ReadingsStore, joined

TABLE, CARD, MAP, URDF = "frames.parquet", "README.md", "truth_map.yaml", "robot.urdf"
MAX_TABLE = 50_000_000
"""Rows."""
BLOCK_ROWS = 1024
"""Rows that are read at a time."""
MAX_URDF = 10_000_000
"""Bytes."""

POSE = ("x", "y", "theta")
GROUPS = {
    "odometry": POSE,
    "twist": ("vx", "vy", "omega"),
    "command": ("speed", "turn_rate"),
    "truth": POSE,
    "mount": POSE,
}
"""Columns that are known or unknown together."""
GROUP_ROWS = 1024
"""Least number of rows in a group of rows; smaller groups take longer to write and to read."""
RANGES = "ranges.list.element"
"""Path of the column of readings within the file."""
LISTS = ("ranges", "angles", "time_offsets")
"""Columns with a list in each row."""
COLUMNS = {
    "stamp": "time [s]",
    "odometry_x, _y, _theta": "pose by wheel odometry, T_odom_robot [m, m, rad]",
    "twist_vx, _vy, _omega": "velocity by odometry while the scan was taken, robot's frame [m/s, m/s, rad/s]",
    "command_speed, _turn_rate": "command that the robot keeps from then on [m/s, rad/s]",
    "truth_x, _y, _theta": "true pose, T_world_robot [m, m, rad]",
    "lidar": "name of the lidar's mount, such as `laser`; null where the frame has no scan",
    "ranges": "readings [m]; infinite = no return, NaN = lost, below range_min = too near",
    "angles": "direction of each beam in the lidar's frame [rad], counter-clockwise",
    "time_offsets": "time of each beam after the stamp [s]",
    "range_min, range_max": "a reading r is a hit where range_min <= r < range_max [m]",
    "mount_x, _y, _theta": "pose of the lidar on the robot, T_robot_lidar [m, m, rad]",
}
"""Meaning of each column, as the dataset card states it."""


def write_parquet(path: str | Path, blocks: Iterable[FrameTable], head: LogHead) -> None:
    """Write blocks as a directory `path`, which must not exist yet; equal blocks give equal bytes."""
    import pyarrow.parquet as pq

    path = Path(path)
    path.mkdir(parents=True)
    totals = _Totals()
    with (
        (path / TABLE).open("wb") as opened,  # by a path, the library refuses names that are no UTF-8
        pq.ParquetWriter(
            opened,
            _schema(),
            compression=_compression(),
            column_encoding={RANGES: "BYTE_STREAM_SPLIT"},
            write_statistics=[name for name in _schema().names if name not in LISTS],  # of no use for readings
            write_page_checksum=True,
            use_dictionary=["lidar"],  # zstd finds the angles of the scan before sooner than a dictionary is made
        ) as writer,
    ):
        group: list[Any] = []
        for block in blocks:
            totals.add(block)
            group.append(arrow_table(block))
            if sum(map(len, group)) >= GROUP_ROWS:
                _write_group(writer, group)
        _write_group(writer, group)
    (path / CARD).write_text(_card(path.name, totals, head), encoding="utf-8")
    if head.truth_map is not None:
        write_map(path / MAP, head.truth_map)
    if head.robot_urdf is not None:
        (path / URDF).write_text(head.robot_urdf, encoding="utf-8")


def _write_group(writer: Any, group: list[Any]) -> None:
    """Write tables as one group of rows, and empty the list."""
    import pyarrow as pa

    if group:
        table = pa.concat_tables(group)
        writer.write_table(table, row_group_size=len(table))
        group.clear()


def _compression() -> dict[str, str]:
    """How each column is packed, by its path.

    The bytes of all ranges are split by their place, so that the first ones, which repeat, are side by side: LZ4 then
    packs them better than zstd packs whole numbers (12 % fewer bytes), in three quarters of the time.
    """
    paths = [f"{name}.list.element" if name in LISTS else name for name in _schema().names]
    return {path: "lz4" if path == RANGES else "zstd" for path in paths}


def read_parquet(path: Path) -> Log:
    """Read what `write_parquet` wrote; the directory, or its table alone.

    Raises LogError, naming the file, the row and what was expected, for damaged tables, columns that are missing, and
    values that make no sense.
    """
    directory, file = (path, path / TABLE) if path.is_dir() else (path.parent, path)
    if path.is_dir():
        verify(directory)
    blocks = _Blocks(file)
    for rows in _read_blocks(file):
        blocks.add(rows)
    if not blocks.rows:
        raise LogError(f"{file}: no rows, expected one a frame")
    table = blocks.table()
    has_map, urdf = path.is_dir() and (directory / MAP).is_file(), directory / URDF
    return Log(
        path=path,
        format="Parquet table",
        table=table,
        notes=(NANOSECONDS_NOTE,) if blocks.first_stamp != table.stamps[0] else (),
        truth_map=read_map(directory / MAP, inside=True) if has_map else None,
        robot_urdf=_read_text(urdf) if path.is_dir() and urdf.is_file() else None,
    )


def _schema() -> Any:
    import pyarrow as pa

    number, numbers = pa.float64(), pa.list_(pa.float64())
    fields = [("stamp", number)]
    fields += [(f"{group}_{name}", number) for group, names in GROUPS.items() for name in names if group != "mount"]
    fields += [("lidar", pa.string()), ("ranges", numbers), ("angles", numbers), ("time_offsets", numbers)]
    fields += [("range_min", number), ("range_max", number), *((f"mount_{name}", number) for name in POSE)]
    return pa.schema(fields)


def arrow_table(block: FrameTable) -> Any:
    """A block as an arrow table; what is unknown is null."""
    import pyarrow as pa

    n, rows = len(block), block.scan_rows
    columns: dict[str, Any] = {"stamp": block.stamps}
    values = {"odometry": block.odometry, "twist": block.twist, "command": block.command, "truth": block.truth}
    values["mount"] = _spread(block.mounts, rows, n)
    for group, names in GROUPS.items():
        unknown = ~block.known(values[group])
        columns |= {
            f"{group}_{name}": pa.array(np.ascontiguousarray(values[group][:, k]), mask=unknown)
            for k, name in enumerate(names)
        }
    bare = np.ones(n, dtype=bool)
    bare[rows] = False
    limits = _spread(block.range_limits, rows, n)
    columns["range_min"], columns["range_max"] = (pa.array(np.ascontiguousarray(c), mask=bare) for c in limits.T)
    names_of_rows = np.full(n, None, dtype=object)
    names_of_rows[rows] = np.array(block.lidars, dtype=object)[block.scan_lidars]
    columns["lidar"] = pa.array(names_of_rows, pa.string())
    patterns = [block.patterns[k] for k in block.scan_patterns.tolist()]
    columns["ranges"] = _lists(np.asarray(block.ranges, dtype=np.float64), rows, block.readings, n)
    columns["angles"] = _lists(_joined([p.angles for p in patterns]), rows, block.readings, n)
    timed = np.array([p.time_offsets is not None for p in patterns], dtype=bool)
    times = _joined([p.time_offsets for p in patterns if p.time_offsets is not None])
    columns["time_offsets"] = _lists(times, rows[timed], block.readings[timed], n)
    return pa.table({name: columns[name] for name in _schema().names}, schema=_schema())


def _spread(values: NDArray[np.float64], rows: Integers, n: int) -> NDArray[np.float64]:
    """Values of scans (m, k) at the rows of their frames, NaN elsewhere, (n, k)."""
    spread = np.full((n, values.shape[1]), np.nan)
    spread[rows] = values
    return spread


def _joined(arrays: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Arrays one after the other; the result is read-only, and shared where all are the same one."""
    if not arrays:
        return np.empty(0)
    first = arrays[0]
    if len(arrays) > 1 and all(array is first for array in arrays):
        copies = 1 << (len(arrays) - 1).bit_length()  # few different numbers of copies, so that they are found again
        return _copies(first.tobytes(), copies)[: len(arrays) * len(first)]
    return np.concatenate(arrays)


@lru_cache(maxsize=8)
def _copies(values: bytes, count: int) -> NDArray[np.float64]:
    """So many copies of an array, one after the other."""
    return np.frombuffer(values * count)


def _lists(values: NDArray[np.float64], rows: Integers, counts: Integers, n: int) -> Any:
    """A column of lists: `counts` values each at some rows, null at the others."""
    import pyarrow as pa

    sizes = np.zeros(n, dtype=np.int32)
    sizes[rows] = counts
    null = np.ones(n, dtype=bool)
    null[rows] = False
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), pa.array(values), mask=pa.array(null))


def _read_blocks(file: Path) -> Iterator[Any]:
    """The table in pieces of `BLOCK_ROWS`; LogError for anything that is not such a table."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with (
            file.open("rb") as opened,
            pq.ParquetFile(opened, page_checksum_verification=True, pre_buffer=False) as parquet,
        ):
            if parquet.metadata.num_rows > MAX_TABLE:
                raise LogError(f"{file}: {parquet.metadata.num_rows} rows, expected at most {MAX_TABLE}")
            if missing := [name for name in _schema().names if name not in parquet.schema_arrow.names]:
                raise LogError(f"{file}: no column {', '.join(missing)}")
            for batch in parquet.iter_batches(BLOCK_ROWS, columns=_schema().names):
                yield pa.Table.from_batches([batch]).select(_schema().names).cast(_schema()).combine_chunks()
    except (pa.ArrowException, OSError, ValueError) as error:  # all mean a damaged or foreign table
        if isinstance(error, LogError):
            raise
        raise LogError(f"{file}: damaged or unreadable table: {shortened(' '.join(str(error).split()))}") from None


class _Blocks:
    """The frames of the blocks of a table, whose readings go to a store; LogError, with the first row, where they make
    no sense."""

    def __init__(self, file: Path) -> None:
        self.rows = 0
        self.first_stamp = math.nan
        """As the table has it."""
        self._file = file
        self._blocks: list[FrameTable] = []
        self._readings = ReadingsStore(kind=np.float64)
        self._patterns: list[BeamPattern] = []
        self._known: dict[tuple[bytes, bytes | None], int] = {}

    def add(self, table: Any) -> None:
        """Take in a block."""
        if not len(table):
            return
        if not self.rows:
            self.first_stamp = float(_numbers(table, "stamp")[0])
        block = self._frames(table)
        self._blocks.append(replace(block, ranges=self._readings.keep(block.ranges.astype(np.float64, copy=False))))
        self.rows += len(table)

    def table(self) -> FrameTable:
        """All frames."""
        blocks = self._blocks
        lidars = tuple(sorted({name for block in blocks for name in block.lidars}))
        firsts = np.cumsum([0, *map(len, blocks)])
        counts = [np.diff(block.scan_starts) for block in blocks]

        def column(name: str) -> Any:
            return np.concatenate([getattr(block, name) for block in blocks])

        return FrameTable(
            **{name: column(name) for name in ("stamps", "odometry", "twist", "command", "truth")},
            scan_rows=np.concatenate([block.scan_rows + first for block, first in zip(blocks, firsts, strict=False)]),
            scan_lidars=np.concatenate(
                [np.array([lidars.index(name) for name in b.lidars], dtype=np.int64)[b.scan_lidars] for b in blocks]
            ),
            scan_patterns=column("scan_patterns"),
            scan_starts=np.concatenate([[0], np.cumsum(np.concatenate(counts))]).astype(np.int64),
            ranges=joined([block.ranges for block in blocks]),
            range_limits=column("range_limits"),
            mounts=column("mounts"),
            lidars=lidars,
            patterns=tuple(self._patterns),
        )

    def _frames(self, table: Any) -> FrameTable:
        """The frames of a block, whose patterns are those of all blocks so far."""
        return _frame_table(self._file, table, self.rows, self.first_stamp, self._patterns, self._known)


def _frame_table(
    file: Path,
    table: Any,
    first: int,
    first_stamp: float,
    patterns: list[BeamPattern],
    known: dict[tuple[bytes, bytes | None], int],
) -> FrameTable:
    """The frames of a block that begins with row `first`; LogError, with the first row, where they make no sense."""

    def refuse(bad: Any, text: str) -> None:
        if bad.any():
            raise LogError(f"{file}: row {first + int(np.argmax(bad))}: {text}")

    numbers = {name: _numbers(table, name) for name in table.column_names if name not in ("lidar", *LISTS)}
    groups = {}
    for group, names in GROUPS.items():
        columns = [numbers[f"{group}_{name}"] for name in names]
        null = np.column_stack([_nulls(table, f"{group}_{name}") for name in names])
        groups[group] = np.column_stack(columns)
        bad = ~null.all(axis=1) & ~(np.isfinite(groups[group]).all(axis=1) & ~null.any(axis=1))
        refuse(bad, f"{group}: expected {len(names)} finite numbers or none")
    refuse(~np.isfinite(numbers["stamp"]) | np.isnan(groups["odometry"][:, 0]), "expected a finite stamp and odometry")
    stamps, impossible = column_in_seconds(numbers["stamp"], first_stamp)
    refuse(impossible, f"a stamp that is no time, {EXPECTED}")
    scanned = ~_nulls(table, "ranges")
    incomplete = _nulls(table, "angles") | np.isnan(groups["mount"][:, 0]) | _nulls(table, "lidar")
    refuse(scanned & incomplete, "expected angles, mount and lidar with the ranges")
    limits = np.column_stack([numbers["range_min"], numbers["range_max"]])
    refuse(
        scanned & ~((limits[:, 1] > limits[:, 0]) & (limits[:, 0] >= 0.0)),
        "expected 0 <= range_min < range_max",
    )
    rows = np.flatnonzero(scanned)
    lists = {name: _flattened(table, name) for name in LISTS}
    for name in ("angles", "time_offsets"):
        uneven = scanned & ~_nulls(table, name) & (lists[name][1] != lists["ranges"][1])
        refuse(uneven, f"expected as many {name} as ranges")
        values, counts = lists[name]
        broken = np.zeros(len(counts), bool)
        broken[np.repeat(np.arange(len(counts)), counts)[~np.isfinite(values)]] = True
        refuse(broken, f"{name}: expected finite numbers")
    lidars, lidar_of = np.unique(
        np.array(table["lidar"].to_pylist(), dtype=object)[rows].astype(str), return_inverse=True
    )
    pattern_of = _patterns_of(lists, rows, ~_nulls(table, "time_offsets"), patterns, known)
    return FrameTable(
        stamps=stamps,
        odometry=groups["odometry"],
        twist=groups["twist"],
        command=groups["command"],
        truth=groups["truth"],
        scan_rows=rows,
        scan_lidars=lidar_of.astype(np.int64),
        scan_patterns=pattern_of,
        scan_starts=np.concatenate([[0], np.cumsum(lists["ranges"][1][rows])]).astype(np.int64),
        ranges=lists["ranges"][0],
        range_limits=limits[rows],
        mounts=groups["mount"][rows],
        lidars=tuple(lidars.tolist()),
        patterns=tuple(patterns),
    )


def _numbers(table: Any, name: str) -> NDArray[np.float64]:
    """A column of numbers, NaN where null; another object than the table's, which is read-only."""
    return np.array(table[name].to_numpy(), dtype=np.float64)


def _nulls(table: Any, name: str) -> NDArray[np.bool_]:
    return np.asarray(table[name].is_null().to_numpy(), dtype=bool)


def _flattened(table: Any, name: str) -> tuple[NDArray[np.float64], Integers]:
    """All values of a column of lists, and the length of each list (n,), 0 where it is null."""
    import pyarrow.compute as pc

    column = table[name]
    values = pc.list_flatten(column)
    lengths = pc.fill_null(pc.list_value_length(column), 0)
    flat = np.concatenate([chunk.to_numpy(zero_copy_only=False) for chunk in values.chunks] or [np.empty(0)])
    return flat, lengths.to_numpy().astype(np.int64)


def _patterns_of(
    lists: dict[str, tuple[NDArray[np.float64], Integers]],
    rows: Integers,
    timed: NDArray[np.bool_],
    patterns: list[BeamPattern],
    known: dict[tuple[bytes, bytes | None], int],
) -> Integers:
    """The pattern of each scan at `rows`, (m,); new ones are appended, and `known` tells where each stands."""
    ends = {name: np.cumsum(lists[name][1]) for name in ("angles", "time_offsets")}
    numbers: list[int] = []
    for row in rows.tolist():
        angles, times = (
            lists[name][0][ends[name][row] - lists[name][1][row] : ends[name][row]]
            for name in ("angles", "time_offsets")
        )
        key = angles.tobytes(), times.tobytes() if timed[row] else None
        number = known.setdefault(key, len(patterns))
        if number == len(patterns):
            patterns.append(BeamPattern(angles=angles.copy(), time_offsets=times.copy() if timed[row] else None))
        numbers.append(number)
    return np.array(numbers, dtype=np.int64)


def _read_text(path: Path) -> str:
    if path.stat().st_size > MAX_URDF:
        raise LogError(f"{path}: larger than {MAX_URDF} bytes")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise LogError(f"{path}: byte {error.start} is not UTF-8") from None


class _Totals:
    """What the card says of the frames, summed up over blocks."""

    def __init__(self) -> None:
        self.frames, self.scans, self.first, self.last = 0, 0, math.inf, -math.inf
        self.known: set[str] = set()

    def add(self, block: FrameTable) -> None:
        """Take in a block."""
        self.frames += len(block)
        self.scans += len(block.scan_rows)
        self.first = min(self.first, float(block.stamps.min()))
        self.last = max(self.last, float(block.stamps.max()))
        columns = {"truth": block.truth, "twist": block.twist, "command": block.command}
        self.known |= {name for name, column in columns.items() if block.known(column).any()}


def _card(name: str, totals: _Totals, head: LogHead) -> str:
    """The dataset card: a YAML head for the hub, and what a person needs to know."""
    lidars = ", ".join(
        f"`{name}` ({lidar.model})" if lidar.model else f"`{name}`" for name, lidar in sorted(head.lidars.items())
    )
    also = ", ".join(part for part in ("truth", "twist", "command") if part in totals.known) or "nothing"
    licence = f"license: {head.licence}\n" if head.licence else ""
    table = "\n".join(f"| `{column}` | {meaning} |" for column, meaning in COLUMNS.items())
    return f"""---
pretty_name: {name}
{licence}tags: [robotics, slam, lidar, 2d-mapping]
configs:
- config_name: default
  data_files: {TABLE}
---
# {name}

A robot's drive with a 2D lidar, for SLAM: {totals.frames} frames, {totals.scans} of them with a scan, over
{totals.last - totals.first:.1f} s. Lidars: {lidars or "none"}. Also recorded: {also}.

`{TABLE}` has a row a frame, in the order of the recording; what is unknown is null.

| column | meaning |
|---|---|
{table}

Angles in radians, counter-clockwise; distances in metres; stamps in seconds. `{MAP}`, where it is there, is the true
map (ROS map_server), in the frame of the true poses; `{URDF}` describes the robot.
"""
