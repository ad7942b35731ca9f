# SPDX-License-Identifier: MIT
"""Index, card and contact sheet of a collection, written together, and what the collection holds in one line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from testbed.datasets.card import NO_CHANGE, Publication, write_card, write_contact_sheet
from testbed.datasets.collection import Collection
from testbed.datasets.index import chosen_splits, write_index


def describe(
    directory: Path,
    *,
    command: str | None = None,
    publication: Publication = NO_CHANGE,
    chosen: Mapping[str, str] | None = None,
) -> str:
    """Write index, card and contact sheet of a collection; return what it holds, a line or two.

    command: the command that has made datasets of it, for the card
    publication: title, author and address for the card
    chosen: split of worlds by name, empty = by the hash of the names, None = as the last index, see `write_index`
    Raises ValueError where there are no datasets.
    """
    rows = write_index(directory, chosen)
    if not rows:
        raise ValueError(f"{directory}: no datasets in it, expected directories that testbed simulate wrote")
    card = write_card(directory, rows, command, publication)
    write_contact_sheet(directory, rows)
    collection = Collection(directory, rows)
    totals = collection.totals()
    splits = ", ".join(f"{count} {split}" for split, count in totals["splits"].items())
    worlds = f"{totals['worlds']} world{'' if totals['worlds'] == 1 else 's'}"
    lines = [
        f"{directory}: {totals['datasets']} dataset{'' if totals['datasets'] == 1 else 's'} of {worlds} ({splits}), "
        f"{totals['seconds'] / 3600:.2f} h, {totals['metres'] / 1000:.2f} km, {totals['bytes'] / 1e6:.0f} MB; see "
        + ("README.md and contact_sheet.png" if card else "contact_sheet.png; README.md is yours and was kept")
    ]
    if advice := collection.split_advice():
        lines.append(advice)
    if named := chosen_splits(directory):
        worlds = ", ".join(f"{world}: {split}" for world, split in named.items())
        lines.append(f"Splits as chosen ({worlds}); `testbed datasets index {directory} --by-hash` undoes the choice.")
    elif advice := collection.lopsided_advice():
        lines.append(advice)
    return "\n".join(lines)
