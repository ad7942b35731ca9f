# SPDX-License-Identifier: MIT
"""Many datasets in one directory, as `testbed simulate --count` writes them."""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from testbed.datasets.index import INDEX, SPLITS, datasets_in, index_rows, natural_order, read_index
from testbed.datasets.loading import Dataset, open_dataset, require_pandas
from testbed.datasets.lopsided import lopsided
from testbed.formats import LogError
from testbed.formats.checksums import CONFIG

if TYPE_CHECKING:
    import pandas as pd


class Collection(Sequence[Dataset]):
    """Datasets by number; made by `open_collection`. Each access opens one again, so that none stays in memory."""

    def __init__(self, path: Path, rows: list[dict[str, Any]]) -> None:
        self.path = path
        self.rows = rows
        """Rows of the index, one for each dataset; `testbed.datasets.index.COLUMNS` says what the columns mean."""

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, number: int | str) -> Dataset: ...

    @overload
    def __getitem__(self, number: slice) -> Collection: ...

    def __getitem__(self, number: int | str | slice) -> Dataset | Collection:
        """One dataset by its number or name, such as `office-0001`, or several by a slice.

        Raises KeyError where no dataset has the name, IndexError for a number that is too large.
        """
        if isinstance(number, slice):
            return Collection(self.path, self.rows[number])
        if isinstance(number, str):
            if number not in (row["dataset"] for row in self.rows):
                raise KeyError(f"{number}: no dataset of this collection; see its column `dataset`")
            return open_dataset(self.path / number)
        return open_dataset(self.path / self.rows[number]["dataset"])

    def __iter__(self) -> Iterator[Dataset]:
        return (self[number] for number in range(len(self)))

    def split(self, name: str) -> Collection:
        """The datasets of `train`, `validation` or `test`; no world is in two of them. Warns where there are none."""
        if name not in SPLITS:
            raise ValueError(f"split {name!r}: expected train, validation or test")
        return self._where(split=name)

    def where(self, **values: object) -> Collection:
        """The datasets whose columns of the index have these values, such as `where(world="office", lidar="lds01")`.

        Raises ValueError for unknown columns. Warns where there are no such datasets.
        """
        return self._where(**values)

    def _where(self, **values: object) -> Collection:
        if unknown := [name for name in values if self.rows and name not in self.rows[0]]:
            raise ValueError(f"no column {', '.join(unknown)} in the index, expected {', '.join(self.rows[0])}")
        found = Collection(self.path, [row for row in self.rows if all(row[n] == v for n, v in values.items())])
        if self.rows and not found.rows:
            warnings.warn(f"{self.path}: {self._why_none(values)}", stacklevel=3)
        return found

    def _why_none(self, values: Mapping[str, object]) -> str:
        """Say why no datasets have these values."""
        for name, value in values.items():
            there = sorted({str(row[name]) for row in self.rows}, key=natural_order)
            if str(value) not in there:
                more = f" and {len(there) - 12} others" if there[12:] else ""
                advice = f" {self.split_advice()}" if name == "split" else ""
                return f"no dataset has {name} {value}, only {', '.join(there[:12])}{more}.{advice}".rstrip()
        return f"no dataset has {' and '.join(f'{name} {value}' for name, value in values.items())} at the same time."

    def split_advice(self) -> str:
        """Why a split is empty and what to do; an empty text where none is."""
        splits, worlds = self.totals()["splits"], len({row["world"] for row in self.rows})
        missing = " and ".join(name for name in SPLITS if not splits[name])
        if not missing or len(self.rows) < 2:
            return ""
        if worlds == 1:
            return f"Nothing for {missing}: there is one world, and three or more give all splits."
        if worlds == 2 and splits["train"] and splits["test"]:
            return f"Nothing for {missing}: there are two worlds, and three or more give all splits."
        return (
            f"Nothing for {missing}: the splits were chosen; `testbed datasets index --help` says how to change them."
        )

    def lopsided_advice(self) -> str:
        """What to do where most of the driving time is not for training; an empty text where training has enough."""
        seconds: defaultdict[str, float] = defaultdict(float)
        for row in self.rows:
            seconds[row["world"]] += row["seconds"]
        return lopsided(seconds, {row["world"]: row["split"] for row in self.rows}, self.path)

    def to_pandas(self) -> pd.DataFrame:
        """The index as a table, a row a dataset."""
        import pyarrow as pa

        require_pandas()
        frame: pd.DataFrame = pa.Table.from_pylist(self.rows).to_pandas()
        return frame

    def totals(self) -> dict[str, Any]:
        """How much there is: datasets, worlds, seconds, metres, scans, bytes, robots, formats, datasets of each split.

        `of_split` has the first six of these for each split, `split_worlds` the names of its worlds, `lidars` the
        datasets of each lidar by split;
        `largest_overlap` is the largest share of its way that a drive has in common with another one of its world in
        order and direction, `largest_same_places` that in any; None where no world has two.
        """
        rows = self.rows
        return {
            **_amounts(rows),
            "of_split": {name: _amounts([row for row in rows if row["split"] == name]) for name in SPLITS},
            "splits": _by_split(rows),
            "split_worlds": {
                name: sorted({row["world"] for row in rows if row["split"] == name}, key=natural_order)
                for name in SPLITS
            },
            **{f"{name}s": sorted({str(row.get(name, "")) for row in rows}) for name in ("robot", "format")},
            "lidars": {
                lidar: _by_split([row for row in rows if row["lidar"] == lidar])
                for lidar in sorted({row["lidar"] for row in rows})
            },
            **{
                f"largest_{name}": max((row[name] for row in rows if row.get(name) is not None), default=None)
                for name in ("overlap", "same_places")
            },
        }

    def __repr__(self) -> str:
        parts = self.totals()
        splits = ", ".join(f"{count} {name}" for name, count in parts["splits"].items())
        many = [f"{parts[name]} {name if parts[name] != 1 else name[:-1]}" for name in ("datasets", "worlds")]
        return f"<Collection {self.path.resolve().name!r}: {' of '.join(many)} ({splits})>"


def _amounts(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How much some datasets are."""
    return {
        "datasets": len(rows),
        "worlds": len({row["world"] for row in rows}),
        "seconds": round(sum(row["seconds"] for row in rows), 3),
        "metres": round(sum(row["metres"] or 0.0 for row in rows), 3),
        "scans": sum(row["scans"] or 0 for row in rows),
        "bytes": sum(row["bytes"] for row in rows),
    }


def _by_split(rows: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Number of datasets of each split."""
    return {name: sum(row["split"] == name for row in rows) for name in SPLITS}


def open_collection(path: str | Path) -> Collection:
    """Open a directory of datasets by its index, `datasets.parquet`; a single dataset needs none.

    Raises LogError where there is no index of several datasets, or where it names a dataset that is not there.
    """
    path = Path(path)
    if not path.is_dir():
        raise LogError(f"{path}: no such directory")
    there = {found.name for found in datasets_in(path)}
    if not there and (path / CONFIG).is_file():
        raise LogError(f"{path}: is one dataset, expected a directory of several; in Python, use open_dataset for it")
    rows = index_rows(path) if len(there) == 1 and not (path / INDEX).exists() else read_index(path)
    if missing := [row["dataset"] for row in rows if row["dataset"] not in there]:
        raise LogError(f"{path}: the index names {missing[0]}, which is not there; run testbed datasets index {path}")
    return Collection(path, rows)
