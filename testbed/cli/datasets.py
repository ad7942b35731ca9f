# SPDX-License-Identifier: MIT
"""`testbed datasets`: what is in a collection."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from rich.table import Table

from testbed.cli.shared.console import results
from testbed.cli.shared.help_texts import HELP

app = App(name="datasets", help=HELP["datasets"])


@app.command
def info(directory: Path, *, as_json: Annotated[bool, Parameter(name="--json", negative=())] = False) -> None:
    """Print the totals of a collection: datasets, worlds, time, metres, scans, size, and its splits.

    Parameters
    ----------
    directory
        Directory that `testbed simulate` wrote datasets to.
    as_json
        Print JSON, for other programs.
    """
    from testbed.datasets import Collection, open_collection
    from testbed.datasets.index import SPLITS, natural_order

    collection = open_collection(directory)
    totals = collection.totals()
    if as_json:
        results.print(json.dumps(totals), highlight=False)
        return
    table = Table(box=None, pad_edge=False)
    for name in ("split", "datasets", "worlds", "hours", "km", "scans", "MB"):
        table.add_column(name, justify="left" if name == "split" else "right")
    for split in (*SPLITS, "all"):
        rows = [row for row in collection.rows if split in ("all", row["split"])]
        part = Collection(directory, rows).totals()
        numbers = (part["datasets"], part["worlds"], f"{part['seconds'] / 3600:.2f}", f"{part['metres'] / 1000:.2f}")
        table.add_row(split, *map(str, (*numbers, part["scans"], f"{part['bytes'] / 1e6:.1f}")))
    results.print(table)
    if advice := collection.split_advice():
        results.print(advice)
    for name in ("world", "robot", "format"):
        values = sorted({str(row[name]) for row in collection.rows}, key=natural_order)
        more = f" and {len(values) - 12} others" if values[12:] else ""
        results.print(f"{name}{'' if len(values) == 1 else 's'}: {', '.join(values[:12])}{more}")
    lidars = Table(box=None, pad_edge=False)
    for name in ("lidar", *SPLITS):
        lidars.add_column(name, justify="left" if name == "lidar" else "right")
    for lidar, counts in totals["lidars"].items():
        lidars.add_row(lidar, *(str(counts[split]) for split in SPLITS))
    results.print(lidars)
    if totals["largest_overlap"] is not None:
        results.print(f"two drives of one world share at most {100.0 * totals['largest_overlap']:.0f} % of their way")
    for trouble in ("collided", "stuck"):
        if count := sum(bool(row[trouble]) for row in collection.rows):
            results.print(f"{trouble}: {count}")
    results.print(f"licence: CC-BY-4.0{' (see README.md)' if (directory / 'README.md').is_file() else ''}")


@app.command
def index(
    directory: Path,
    *,
    test: str = "",
    validation: str = "",
    by_hash: Annotated[bool, Parameter(negative=())] = False,
    title: str | None = None,
) -> None:
    """Write index, card and contact sheet of a collection again, for instance after its last shard.

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
    """
    from testbed.datasets.description import describe

    named = {"test": test, "validation": validation}
    choices = [(world.strip(), split) for split, text in named.items() for world in text.split(",") if world.strip()]
    if twice := {world for world, _ in choices if sum(world == other for other, _ in choices) > 1}:
        raise ValueError(f"{', '.join(sorted(twice))}: named twice, expected each world in one split")
    if by_hash and choices:
        raise ValueError("--by-hash: undoes a choice, expected no --test and no --validation with it")
    results.print(describe(directory, title=title, chosen={} if by_hash else dict(choices) or None))
