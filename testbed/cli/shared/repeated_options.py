# SPDX-License-Identifier: MIT
"""What to type so that datasets that were made with other settings are kept: the options that made them."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from testbed.cli.shared.draws import Draw, drawn
from testbed.cli.shared.help_pages import SHORT_NAMES
from testbed.datasets import open_dataset
from testbed.datasets.card import commands_in
from testbed.settings.simulator import SimulatorOptions


class WantedDrive(NamedTuple):
    """The drive that a command is to make."""

    world: str
    """Name or file of the world."""
    seed: int
    simulator: SimulatorOptions
    drawn: Collection[str]
    """Settings that the command draws."""


def advice(path: Path, wanted: WantedDrive, differing: Mapping[str, Any]) -> str:
    """What to do about a dataset of other settings.

    path: the dataset
    differing: the settings that differ, such as `odometry.grade`, and their values there; None where it has none
    """
    draws = open_dataset(path).config.get("draws", {})
    repeated: list[str] = []
    left_out: list[str] = []
    for key, value in differing.items():
        if key in draws:
            repeated.append(_draw_option(path.parent, wanted, key, value))
        elif (option := _option(key, value)) is None:
            return "choose another --out"
        else:
            repeated.append(option)
            left_out += [f"--draw {key}"] if key in wanted.drawn else []
    without = f" and leave out {' '.join(left_out)}" if left_out else ""
    return f"repeat {' '.join(repeated)}{without}, or choose another --out"


def _option(key: str, value: object) -> str | None:
    """The option that sets a value; None where there is none that is sure to."""
    name = f"--{key.replace('_', '-')}"
    name = SHORT_NAMES.get(name, name)
    if value is True:
        return name
    return f"{name} {shlex.quote(f'{value}')}" if isinstance(value, str | int | float) and value is not False else None


def _draw_option(collection: Path, wanted: WantedDrive, key: str, value: object) -> str:
    """The `--draw` of the collection's card that gives the value; without values where the card has none."""
    for text in _draws_in_card(collection):
        try:
            draw = Draw.parse(text)
            if draw.key == key and drawn(wanted.simulator, [draw], wanted.world, wanted.seed)[1][key] == value:
                return f"--draw {shlex.quote(text)}"
        except ValueError:  # the owner of the card may have edited it
            continue
    return f"--draw {key}=…"


def _draws_in_card(collection: Path) -> Iterator[str]:
    """Yield what follows `--draw` in the commands that made the datasets of a collection."""
    for command in commands_in(collection):
        try:
            words = shlex.split(command)
        except ValueError:
            continue
        yield from (value for option, value in pairwise(words) if option == "--draw")
