# SPDX-License-Identifier: MIT
"""The index of a collection: `datasets.parquet`, a row a dataset, with its split by world."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from eval.files.atomic_write import atomic_write
from testbed.datasets.overlap import NEAR, Overlap, largest_overlaps
from testbed.formats import LogError
from testbed.formats.checksums import CONFIG, MAX_CONFIG

INDEX = "datasets.parquet"
"""Name of the index in the directory of a collection."""
TEST_SHARE, VALIDATION_SHARE = 0.15, 0.15
"""Shares of the worlds that are kept for testing and for validation."""

SPLITS = ("train", "validation", "test")
CHOSEN = b"testbed_splits"
"""Key of the chosen splits in the table's metadata."""

COLUMNS = {
    "dataset": "name of the directory",
    "split": "train, validation or test; which all datasets of one world have in common",
    "world": "name of the world",
    "seed": "seed of the drive; unless the route is fixed, each seed drives another way",
    "variant": "name of the sensor variant, empty without --vary",
    "format": "format of the recording",
    "robot": "preset of the robot",
    "lidar": "preset of the lidar, such as `lds01`, several are separated by commas; frames name its mount instead",
    "route": "fixed: the world's tour; random: all of the tour, in another order; stops: to random stops on all floor",
    "seconds": "simulated time [s]",
    "metres": "length of the true path [m]",
    "overlap": "largest share of its way that another drive of this world has too, in the same direction and order",
    "same_places": f"the same within {NEAR:g} m, in any direction and order: at least as large as `overlap`",
    "scans": "number of scans, of all lidars",
    "bytes": "size of all files [bytes]",
    "finished": "the robot finished its route; false where `--duration` ended the drive before",
    "collided": "the robot touched something",
    "stuck": "the robot gave up",
    "draws": "settings that were drawn for this dataset, as JSON",
    "settings": "all settings, as JSON",
    "sha256": "SHA-256 of the dataset's config.toml, which holds those of all other files",
}
"""Columns of the index and what they mean."""


def datasets_in(directory: Path) -> list[Path]:
    """The directories of datasets in a directory, sorted by name: `rooms-2` comes before `rooms-10`."""
    if not directory.is_dir():
        return []
    return sorted(
        (path for path in directory.iterdir() if path.is_dir() and _is_dataset(path)),
        key=lambda path: natural_order(path.name),
    )


def natural_order(name: str) -> list[tuple[int, str]]:
    """Sort key of a name: its text and its numbers, in turn."""
    return [(int(part), part) if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


def write_index(directory: Path, chosen: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Write the index of all datasets in a directory; its rows. Equal datasets give equal bytes.

    chosen: split of worlds by name, see `splits`; empty = by the hash; None = as the last index of the directory
    Raises LogError where a config.toml cannot be read, ValueError where a chosen world has no datasets.
    """
    chosen = chosen_splits(directory) if chosen is None else chosen
    rows = index_rows(directory, chosen)
    if rows:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.Table.from_pylist(rows)
        for name in Overlap._fields:  # also where all are unknown
            table = table.set_column(table.column_names.index(name), name, table[name].cast(pa.float64()))
        if chosen:
            table = table.replace_schema_metadata({CHOSEN: json.dumps(dict(sorted(chosen.items())))})
        with atomic_write(directory / INDEX) as temporary, temporary.open("wb") as opened:
            pq.write_table(table, opened, compression="zstd")
    return rows


def index_rows(directory: Path, chosen: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Rows of the index of all datasets in a directory, as `write_index` writes them."""
    rows = [_row(path) for path in datasets_in(directory)]
    split = splits((row["world"] for row in rows), chosen)
    for row, overlap in zip(rows, largest_overlaps(directory, rows), strict=True):
        row |= {"split": split[row["world"]], **overlap._asdict()}
    return [{name: row[name] for name in COLUMNS} for row in rows]


def chosen_splits(directory: Path) -> dict[str, str]:
    """The split of worlds that was chosen for the index of a directory; empty where there is none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with (directory / INDEX).open("rb") as opened:
            metadata = pq.read_schema(opened).metadata or {}
        return dict(json.loads(metadata.get(CHOSEN, b"{}")))
    except (pa.ArrowException, OSError, ValueError):  # the index is made anew
        return {}


def indexed_datasets(directory: Path) -> set[str]:
    """Names of the datasets in the index of a directory; empty where there is no index that can be read."""
    try:
        return {row["dataset"] for row in read_index(directory)}
    except LogError:
        return set()


def read_index(directory: Path) -> list[dict[str, Any]]:
    """Rows of the index of a collection; LogError where it is missing or damaged."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = directory / INDEX
    if not file.is_file() and not datasets_in(directory):
        make = f"testbed simulate office,lab --count 2 --out {directory}"
        raise LogError(f"{directory}: no datasets in it; `{make}` makes four")
    if not file.is_file():
        raise LogError(f"{directory}: no {INDEX}; `testbed datasets index {directory}` makes it")
    try:
        with file.open("rb") as opened:
            rows: list[dict[str, Any]] = pq.read_table(opened).to_pylist()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise LogError(f"{file}: damaged or unreadable table: {' '.join(str(error).split())[:200]}") from None
    if rows and (missing := [name for name in ("dataset", "split", "world") if name not in rows[0]]):
        raise LogError(f"{file}: no column {', '.join(missing)}")
    return rows


def splits(worlds: Iterable[str], chosen: Mapping[str, str] | None = None) -> dict[str, str]:
    """The split of each world: about 70 % train, 15 % validation, 15 % test, and no world in two.

    The order is that of a hash of the worlds' names, so that neither names nor kinds of worlds decide. Two worlds are
    one for training and one for testing; a single world is for training.

    chosen: the split of some worlds by name; all others are for training then. Raises ValueError where one of them is
    not among the worlds.
    """
    names = sorted(set(worlds), key=lambda name: hashlib.sha256(name.encode()).digest())
    if chosen:
        if unknown := sorted(set(chosen) - set(names)):
            raise ValueError(f"no datasets of world {', '.join(unknown)}, expected one of {', '.join(sorted(names))}")
        return {name: chosen.get(name, "train") for name in names}
    test = max(round(TEST_SHARE * len(names)), 1) if len(names) > 1 else 0
    validation = max(round(VALIDATION_SHARE * len(names)), 1) if len(names) > 2 else 0
    parts = ["test"] * test + ["validation"] * validation
    return dict(zip(names, parts + ["train"] * (len(names) - len(parts)), strict=True))


def _is_dataset(path: Path) -> bool:
    return not path.name.startswith(".") and (path / CONFIG).is_file() and (path / "world.toml").is_file()


def settings_of(path: Path) -> dict[str, Any]:
    """The settings that made a dataset; LogError where its config.toml cannot be read."""
    settings = _config(path)[0].get("settings")
    if not isinstance(settings, dict):
        raise LogError(f"{path / CONFIG}: expected a table [settings]")
    return settings


def world_in(path: Path) -> str:
    """Name of the world of a dataset; LogError where its config.toml cannot be read."""
    return _world_name(_config(path)[0])


def seconds_of(path: Path) -> float:
    """Simulated time of a dataset [s]; LogError where its config.toml cannot be read."""
    return float(_row(path)["seconds"])


def _world_name(config: Mapping[str, Any]) -> str:
    return str(config.get("world", {}).get("name") or config.get("settings", {}).get("world", ""))


def _config(path: Path) -> tuple[dict[str, Any], bytes]:
    """Content of the config.toml of a dataset, and its bytes."""
    file = path / CONFIG
    if file.stat().st_size > MAX_CONFIG:
        raise LogError(f"{file}: larger than {MAX_CONFIG} bytes")
    content = file.read_bytes()
    try:
        return tomllib.loads(content.decode()), content
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise LogError(f"{file}: {error}, expected TOML") from None


def _row(path: Path) -> dict[str, Any]:
    """A row of the index, without split and overlaps."""
    file = path / CONFIG
    config, content = _config(path)
    try:
        settings, drive = config["settings"], config["drive"]
        return {
            "dataset": path.name,
            "world": _world_name(config),
            "seed": int(settings["seed"]),
            "variant": str(settings.get("variant", "")),
            "format": str(settings.get("format", "")),
            "robot": str(settings.get("robot", "")),
            "lidar": str(settings.get("lidar", "")),
            "route": str(settings.get("route", "fixed")),
            "seconds": float(drive["seconds"]),
            "metres": float(drive["metres"]) if "metres" in drive else None,
            "scans": int(drive["scans"]) if "scans" in drive else None,
            "bytes": sum(part.stat().st_size for part in path.iterdir() if part.is_file()),
            "finished": bool(drive["finished"]),
            "collided": bool(drive["collided"]),
            "stuck": bool(drive["stuck"]),
            "draws": json.dumps(config.get("draws", {}), sort_keys=True),
            "settings": json.dumps(settings, sort_keys=True),
            "sha256": hashlib.sha256(content).hexdigest(),
        }
    except (KeyError, TypeError, ValueError) as error:
        raise LogError(f"{file}: {error}: expected the settings and the drive of a dataset") from None
