# SPDX-License-Identifier: MIT
"""Recordings as Apache Parquet: a directory with one table, a row a frame, and a dataset card. Nothing is rounded.

`frames.parquet` is what pandas, polars, DuckDB and the Hugging Face hub read; the card (README.md) says what its
columns mean. The true map lies beside it as a ROS map, where it is known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.files.map_server import read_map, write_map
from slam.scan import Scan
from testbed.formats.checksums import verify
from testbed.formats.log import Log, LogError
from testbed.frame import Frame

TABLE, CARD, MAP, URDF = "frames.parquet", "README.md", "truth_map.yaml", "robot.urdf"
LARGEST_TABLE = 50_000_000
"""Rows."""
LARGEST_URDF = 10_000_000
"""Bytes."""

POSE = ("x", "y", "theta")
COLUMNS = {
    "stamp": "time [s]",
    "odometry_x, _y, _theta": "pose by wheel odometry, T_odom_robot [m, m, rad]",
    "twist_vx, _vy, _omega": "velocity by odometry while the scan was taken, robot's frame [m/s, m/s, rad/s]",
    "command_speed, _turn_rate": "what the robot was told to keep from then on [m/s, rad/s]",
    "truth_x, _y, _theta": "true pose, T_world_robot [m, m, rad]",
    "lidar": "name of the lidar that took the scan; null where the frame has no scan",
    "ranges": "readings [m]; infinite = no return, NaN = lost, below range_min = too near",
    "angles": "direction of each beam in the lidar's frame [rad], counter-clockwise",
    "time_offsets": "time of each beam after the stamp [s]",
    "range_min, range_max": "a reading r is a hit where range_min <= r < range_max [m]",
    "mount_x, _y, _theta": "pose of the lidar on the robot, T_robot_lidar [m, m, rad]",
}
"""What the card says of the columns."""


def write_parquet(path: str | Path, log: Log) -> None:
    """Write a log as a directory `path`, which must not exist yet; equal logs give equal bytes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = Path(path)
    path.mkdir(parents=True)
    table = pa.table(_columns(log.frames), schema=_schema())
    pq.write_table(table, path / TABLE, compression="zstd", write_page_checksum=True)
    (path / CARD).write_text(_card(path.name, log), encoding="utf-8")
    if log.truth_map is not None:
        write_map(path / MAP, log.truth_map)
    if log.robot_urdf is not None:
        (path / URDF).write_text(log.robot_urdf, encoding="utf-8")


def read_parquet(path: Path) -> Log:
    """Read what `write_parquet` wrote; the directory, or its table alone.

    Raises LogError, naming the file, the row and what was expected, for damaged tables, columns that are missing, and
    values that make no sense.
    """
    directory, file = (path, path / TABLE) if path.is_dir() else (path.parent, path)
    if path.is_dir():
        verify(directory)
    columns = _read_table(file)
    frames = []
    for row, values in enumerate(zip(*columns.values(), strict=True)):
        try:
            frames.append(_frame(dict(zip(columns, values, strict=True))))
        except (ValueError, TypeError) as error:
            raise LogError(f"{file}: row {row}: {error}") from None
    if not frames:
        raise LogError(f"{file}: no rows, expected one a frame")
    has_map, urdf = path.is_dir() and (directory / MAP).is_file(), directory / URDF
    return Log(
        path=path,
        format="Parquet table",
        frames=frames,
        notes=(),
        truth_map=read_map(directory / MAP, inside=True) if has_map else None,
        robot_urdf=_read_text(urdf) if path.is_dir() and urdf.is_file() else None,
    )


def _schema() -> Any:
    import pyarrow as pa

    number, numbers = pa.float64(), pa.list_(pa.float64())
    fields = [("stamp", number), *((f"odometry_{name}", number) for name in POSE)]
    fields += [(f"twist_{name}", number) for name in ("vx", "vy", "omega")]
    fields += [("command_speed", number), ("command_turn_rate", number)]
    fields += [(f"truth_{name}", number) for name in POSE]
    fields += [("lidar", pa.string()), ("ranges", numbers), ("angles", numbers), ("time_offsets", numbers)]
    fields += [("range_min", number), ("range_max", number), *((f"mount_{name}", number) for name in POSE)]
    return pa.schema(fields)


def _columns(frames: Sequence[Frame]) -> dict[str, list[Any]]:
    """Values of all frames by column; None where something is unknown."""
    rows = []
    for frame in frames:
        scan = frame.scan
        row: dict[str, Any] = {"stamp": float(frame.stamp)}
        row |= _spread("odometry", POSE, frame.odometry)
        row |= _spread("twist", ("vx", "vy", "omega"), frame.twist)
        row |= _spread("command", ("speed", "turn_rate"), frame.command)
        row |= _spread("truth", POSE, frame.truth)
        row |= _spread("mount", POSE, None if scan is None else scan.mount)
        row["lidar"] = None if scan is None else frame.lidar
        for name in ("ranges", "angles", "time_offsets", "range_min", "range_max"):
            row[name] = None if scan is None else getattr(scan, name)
        rows.append(row)
    return {name: [row[name] for row in rows] for name in _schema().names}


def _spread(group: str, names: Sequence[str], values: Sequence[float] | NDArray[np.float64] | None) -> dict[str, Any]:
    return {f"{group}_{name}": None if values is None else float(values[k]) for k, name in enumerate(names)}


def _read_table(file: Path) -> dict[str, list[Any]]:
    """Columns as lists; LogError for anything that is not such a table."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(file, page_checksum_verification=True) as parquet:
            if parquet.metadata.num_rows > LARGEST_TABLE:
                raise LogError(f"{file}: {parquet.metadata.num_rows} rows, expected at most {LARGEST_TABLE}")
            if missing := [name for name in _schema().names if name not in parquet.schema_arrow.names]:
                raise LogError(f"{file}: no column {', '.join(missing)}")
            table = parquet.read(columns=_schema().names).cast(_schema())
    except (pa.ArrowException, OSError, ValueError) as error:  # all mean a damaged or foreign table
        if isinstance(error, LogError):
            raise
        raise LogError(f"{file}: damaged or unreadable table: {' '.join(str(error).split())[:300]}") from None
    lists = ("ranges", "angles", "time_offsets")
    return {name: _arrays(table[name]) if name in lists else table[name].to_pylist() for name in table.column_names}


def _arrays(column: Any) -> list[NDArray[np.float64] | None]:
    """A column of lists as arrays, None where null."""
    return [None if not item.is_valid else item.values.to_numpy(zero_copy_only=False) for item in column]


def _frame(row: dict[str, Any]) -> Frame:
    """One row; ValueError where it makes no sense."""
    odometry = _gathered(row, "odometry", POSE)
    if odometry is None or row["stamp"] is None or not math.isfinite(row["stamp"]):
        raise ValueError("expected a finite stamp and odometry")
    command = _gathered(row, "command", ("speed", "turn_rate"))
    scan = None
    if row["ranges"] is not None:
        mount = _gathered(row, "mount", POSE)
        if row["angles"] is None or mount is None or row["lidar"] is None:
            raise ValueError("expected angles, mount and lidar with the ranges")
        if not row["range_max"] > row["range_min"] >= 0.0:
            raise ValueError(f"expected 0 <= range_min < range_max, got {row['range_min']} and {row['range_max']}")
        scan = Scan(
            ranges=row["ranges"],
            angles=row["angles"],
            range_min=row["range_min"],
            range_max=row["range_max"],
            stamp=row["stamp"],
            mount=(float(mount[0]), float(mount[1]), float(mount[2])),
            time_offsets=row["time_offsets"],
        )
    return Frame(
        stamp=row["stamp"],
        odometry=odometry,
        scan=scan,
        lidar=row["lidar"] or Frame.lidar,
        twist=_gathered(row, "twist", ("vx", "vy", "omega")),
        command=None if command is None else (float(command[0]), float(command[1])),
        truth=_gathered(row, "truth", POSE),
    )


def _gathered(row: dict[str, Any], group: str, names: Sequence[str]) -> NDArray[np.float64] | None:
    """Values of a group of columns; None where they are null, ValueError where some are or one is not finite."""
    values = [row[f"{group}_{name}"] for name in names]
    if all(value is None for value in values):
        return None
    if any(value is None or not math.isfinite(value) for value in values):
        raise ValueError(f"{group}: expected {len(values)} finite numbers or none, got {values}")
    return np.array(values)


def _read_text(path: Path) -> str:
    if path.stat().st_size > LARGEST_URDF:
        raise LogError(f"{path}: larger than {LARGEST_URDF} bytes")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise LogError(f"{path}: byte {error.start} is not UTF-8") from None


def _card(name: str, log: Log) -> str:
    """The dataset card: a YAML head for the hub, and what a person needs to know."""
    frames = log.frames
    lidars = sorted({frame.lidar for frame in frames if frame.scan is not None})
    stamps = [frame.stamp for frame in frames]
    known = [part for part in ("truth", "twist", "command") if any(getattr(f, part) is not None for f in frames)]
    besides = ", ".join(known) or "nothing"
    table = "\n".join(f"| `{column}` | {meaning} |" for column, meaning in COLUMNS.items())
    return f"""---
pretty_name: {name}
tags: [robotics, slam, lidar, 2d-mapping]
configs:
- config_name: default
  data_files: {TABLE}
---
# {name}

A robot's drive with a 2D lidar, for SLAM: {len(frames)} frames, {log.scan_count} of them with a scan, over
{max(stamps) - min(stamps):.1f} s. Lidars: {", ".join(lidars) or "none"}. Known besides odometry: {besides}.

`{TABLE}` has a row a frame, in the order of the recording; what is unknown is null.

| column | meaning |
|---|---|
{table}

Angles in radians, counter-clockwise; distances in metres; stamps in seconds. `{MAP}`, where it is there, is the true
map (ROS map_server), in the frame of the true poses; `{URDF}` describes the robot.
"""
