# SPDX-License-Identifier: MIT
"""`testbed datasets`: what is in a collection."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from rich.table import Table

from testbed.cli.shared.console import results
from testbed.cli.shared.help_texts import HELP

app = App(name="datasets", help=HELP["datasets"], help_epilogue="")

LICENCE = "CC-BY-4.0"
MAX_NAMES = 12
"""Names in a line of `info`."""


@app.command
def info(directory: Path, *, as_json: Annotated[bool, Parameter(name="--json", negative=())] = False) -> None:
    """Print the totals of a collection: datasets, worlds, time, metres, scans, size, and its splits.

    Example: `testbed datasets info data`, after `testbed simulate office,lab --out data`

    Parameters
    ----------
    directory
        Directory that `testbed simulate` wrote datasets to.
    as_json
        Print JSON, for other programs.
    """
    from testbed.datasets import Collection, open_collection
    from testbed.datasets.index import SPLITS, chosen_splits

    collection = open_collection(directory)
    totals = collection.totals()
    if as_json:
        more = {"splits_chosen": bool(chosen_splits(directory)), "licence": LICENCE}
        results.print(json.dumps(totals | more), highlight=False)
        return
    table = Table(box=None, pad_edge=False)
    for name in ("split", "datasets", "worlds", "hours", "km", "scans", "MB", "names of the worlds"):
        table.add_column(name, justify="left" if name in ("split", "names of the worlds") else "right")
    for split in (*SPLITS, "all"):
        rows = [row for row in collection.rows if split in ("all", row["split"])]
        part = Collection(directory, rows).totals()
        numbers = (part["datasets"], part["worlds"], f"{part['seconds'] / 3600:.2f}", f"{part['metres'] / 1000:.2f}")
        named = "" if split == "all" else _first_of({row["world"] for row in rows})
        table.add_row(split, *map(str, (*numbers, part["scans"], f"{part['bytes'] / 1e6:.1f}", named)))
    results.print(table)
    if advice := collection.split_advice():
        results.print(advice)
    decided = "were chosen by hand" if chosen_splits(directory) else "come from a hash of the worlds' names"
    results.print(f"the splits {decided}")
    for name, values in (("robot", totals["robots"]), ("format", totals["formats"])):
        results.print(f"{name}{'' if len(values) == 1 else 's'}: {_first_of(values)}")
    lidars = Table(box=None, pad_edge=False)
    for name in ("lidar", *SPLITS):
        lidars.add_column(name, justify="left" if name == "lidar" else "right")
    for lidar, counts in totals["lidars"].items():
        lidars.add_row(lidar, *(str(counts[split]) for split in SPLITS))
    results.print(lidars)
    if totals["largest_overlap"] is not None:
        places = max((row["same_places"] or 0.0 for row in collection.rows), default=0.0)
        results.print(
            f"of their way, two drives of one world share at most {100.0 * totals['largest_overlap']:.0f} % in order "
            f"and direction, {100.0 * places:.0f} % in any order and direction"
        )
    for trouble in ("collided", "stuck"):
        if count := sum(bool(row[trouble]) for row in collection.rows):
            results.print(f"{trouble}: {count}")
    results.print(f"licence: {LICENCE}{' (see README.md)' if (directory / 'README.md').is_file() else ''}")


def _first_of(names: Iterable[str]) -> str:
    """The names in natural order, at most `MAX_NAMES` of them."""
    from testbed.datasets.index import natural_order

    ordered = sorted(names, key=natural_order)
    return ", ".join(ordered[:MAX_NAMES]) + (f" and {len(ordered) - MAX_NAMES} others" if ordered[MAX_NAMES:] else "")


@app.command
def index(
    directory: Path,
    *,
    test: str = "",
    validation: str = "",
    by_hash: Annotated[bool, Parameter(negative=())] = False,
    title: str | None = None,
    author: str | None = None,
    url: str | None = None,
) -> None:
    """Write index, card and contact sheet of a collection again, for instance after its last shard.

    Example: `testbed datasets index data --test office`, after `testbed simulate office,lab --out data`

    Parameters
    ----------
    directory
        Directory that `testbed simulate` wrote datasets to.
    test
        Worlds for testing, separated by commas. With `--test` or `--validation` all other worlds are for training, also
        those that are added later. Default: as the last index was made, at first by a hash of the worlds' names.
    validation
        Worlds for validation, separated by commas.
    by_hash
        Undo an earlier choice by `--test` or `--validation`: a hash of the worlds' names decides again.
    title
        Title of the card (README.md); default: that of the card that is there, at first the name of the directory.
    author
        Who publishes the data, for the sentence to cite in the card; default: as in the card that is there.
    url
        Address at which the data are published, for the same sentence; default: as in the card that is there.
    """
    from testbed.datasets.card import Publication
    from testbed.datasets.description import describe

    named = {"test": test, "validation": validation}
    choices = [(world.strip(), split) for split, text in named.items() for world in text.split(",") if world.strip()]
    if twice := {world for world, _ in choices if sum(world == other for other, _ in choices) > 1}:
        raise ValueError(f"{', '.join(sorted(twice))}: named twice, expected each world in one split")
    if by_hash and choices:
        raise ValueError("--by-hash: undoes a choice, expected no --test and no --validation with it")
    chosen = {} if by_hash else dict(choices) or None
    results.print(describe(directory, publication=Publication(title, author, url), chosen=chosen))
