# SPDX-License-Identifier: MIT
"""`testbed datasets`: what is in a collection."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter
from rich.table import Table

from testbed.cli.shared.console import results
from testbed.cli.shared.help_texts import HELP

if TYPE_CHECKING:
    from testbed.datasets import Collection
    from testbed.datasets.card import Publication

app = App(name="datasets", help=HELP["datasets"], help_epilogue="")

LICENCE = "CC-BY-4.0"
MAX_NAMES = 60
"""Names, and ranges of numbers, in a line of `info`."""


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
    from testbed.datasets import open_collection
    from testbed.datasets.card import CARD, NO_CHANGE, stated_publication
    from testbed.datasets.index import SPLITS, chosen_splits

    collection = open_collection(directory)
    totals = collection.totals()
    stated, chosen = stated_publication(directory), bool(chosen_splits(directory))
    if as_json:
        more = {"splits_chosen": chosen, "licence": LICENCE, **(stated or NO_CHANGE)._asdict()}
        results.print(json.dumps(totals | more), highlight=False)
        return
    table = Table(box=None, pad_edge=False)
    for name in ("split", "datasets", "worlds", "hours", "km", "scans", "MB"):
        table.add_column(name, justify="left" if name == "split" else "right")
    for split in (*SPLITS, "all"):
        part = totals["of_split"].get(split, totals)
        numbers = (part["datasets"], part["worlds"], f"{part['seconds'] / 3600:.2f}", f"{part['metres'] / 1000:.2f}")
        table.add_row(split, *map(str, (*numbers, part["scans"], f"{part['bytes'] / 1e6:.1f}")))
    results.print(table)
    _print_splits(collection, chosen=chosen)
    for name, values in (("robot", totals["robots"]), ("format", totals["formats"])):
        results.print(f"{name}{'' if len(values) == 1 else 's'}: {', '.join(values)}")
    lidars = Table(box=None, pad_edge=False)
    for name in ("lidar", *SPLITS):
        lidars.add_column(name, justify="left" if name == "lidar" else "right")
    for lidar, counts in totals["lidars"].items():
        lidars.add_row(lidar, *(str(counts[split]) for split in SPLITS))
    results.print(lidars)
    if totals["largest_overlap"] is not None:
        results.print(
            f"of their way, two drives of one world share at most {100.0 * totals['largest_overlap']:.0f} % in order "
            f"and direction, {100.0 * (totals['largest_same_places'] or 0.0):.0f} % in any order and direction"
        )
    for trouble in ("collided", "stuck"):
        if count := sum(bool(row[trouble]) for row in collection.rows):
            results.print(f"{trouble}: {count}")
    results.print(f"licence: {LICENCE}{f' (see {CARD})' if (directory / CARD).is_file() else ''}")
    if line := _to_publish(stated, directory):
        results.print(line)


def _print_splits(collection: Collection, *, chosen: bool) -> None:
    """Name the worlds of each split, who decided, and what to do where a split is empty or lopsided."""
    for split, worlds in collection.totals()["split_worlds"].items():
        if worlds:
            results.print(f"worlds of {split}: {_named(worlds)}")
    if advice := collection.split_advice():
        results.print(advice)
    decided = "were chosen by hand" if chosen else "come from a hash of the worlds' names"
    results.print(f"the splits {decided}")
    if not chosen and (advice := collection.lopsided_advice()):
        results.print(advice)


def _to_publish(stated: Publication | None, directory: Path) -> str:
    """What is still to do before the data can be published and cited; empty where the card is somebody else's."""
    from testbed.datasets.card import CARD

    if stated is None:
        return "" if (directory / CARD).is_file() else f"to publish: `testbed datasets index {directory}` writes a card"
    options = {"title": "--title TITLE", "author": "--author NAME", "address": "--url ADDRESS"}
    if missing := [name for name, value in zip(options, stated, strict=True) if not value]:
        command = f"testbed datasets index {directory} {' '.join(options[name] for name in missing)}"
        return f"to publish: the card has no {', no '.join(missing)} yet; `{command}` adds that"
    return "to publish: the card has title, author and address, and the sentence to cite"


def _named(worlds: Iterable[str]) -> str:
    """The worlds, those of one kind by their numbers, as in `office, rooms-0 to 13, 17`; at most `MAX_NAMES` parts.

    worlds: names in natural order
    """
    kinds: dict[str, list[int]] = {}
    for world in worlds:
        numbered = re.fullmatch(r"(.*-)(0|[1-9]\d*)", world)
        numbers = kinds.setdefault(numbered[1] if numbered else world, [])
        numbers += [int(numbered[2])] if numbered else []
    parts = [part for kind, numbers in kinds.items() for part in _ranges(kind, numbers)]
    hidden = sum(count for count, _ in parts[MAX_NAMES:])
    more = f" and {hidden} others (`--json` names all)" if hidden else ""
    return ", ".join(text for _, text in parts[:MAX_NAMES]) + more


def _ranges(kind: str, numbers: Sequence[int]) -> Iterator[tuple[int, str]]:
    """Yield how many worlds follow each other without a gap, and their text; the kind is named before the first."""
    if not numbers:
        yield 1, kind
    for _, together in groupby(enumerate(numbers), key=lambda pair: pair[1] - pair[0]):
        run = [number for _, number in together]
        yield len(run), f"{kind}{run[0]} to {run[-1]}" if run[1:] else f"{kind}{run[0]}"
        kind = ""


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
