# SPDX-License-Identifier: MIT
"""`--draw KEY=A,B` and `--draw KEY=LOW..HIGH`: settings that differ between datasets, drawn by their seeds."""

from __future__ import annotations

import tomllib
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from testbed.cli.shared.variants import KEYS, value_of, with_value
from testbed.settings.simulator import SimulatorOptions
from worlds import family, label
from worlds.names import GeneratedName

DRAWN_KEYS = {"robot": SimulatorOptions, **KEYS}
"""Settings that may be drawn, and the class of each."""


class Draw(NamedTuple):
    """A setting to draw."""

    key: str
    choices: tuple[str, ...]
    """Values to choose from; empty for a range."""
    low: float = 0.0
    high: float = 0.0
    """Ends of a range, from which numbers are drawn evenly."""

    @classmethod
    def parse(cls, text: str) -> Draw:
        """Raises ValueError for unknown keys, empty lists, and ranges without a length."""
        key, equals, values = (part.strip() for part in text.partition("="))
        key = key.replace("-", "_")
        if key not in DRAWN_KEYS:
            raise ValueError(f"--draw {text}: expected KEY=A,B or KEY=LOW..HIGH with a key of {', '.join(DRAWN_KEYS)}")
        low, dots, high = values.partition("..")
        if dots:
            try:
                ends = float(low), float(high)
            except ValueError:
                raise ValueError(f"--draw {text}: expected two numbers, such as {key}=0.5..2") from None
            if not -np.inf < ends[0] < ends[1] < np.inf:
                raise ValueError(f"--draw {text}: expected finite numbers, the lower one first")
            return cls(key, (), *ends)
        choices = tuple(value.strip() for value in values.split(","))
        if not equals or "" in choices:
            raise ValueError(f"--draw {text}: expected {key}=A,B or {key}=LOW..HIGH")
        return cls(key, choices)

    def value(self, world: str, seed: int) -> str:
        """The value for a world and a seed, as text; it does not depend on what else is drawn.

        Choices are dealt in turn: of n consecutive seeds of one world, or of n generated worlds of one kind with
        consecutive seeds, each of the n choices gets one, in random order.
        """
        if self.choices:
            group, first = _place_in_turn(world)
            turn, place = divmod(first + seed, len(self.choices))
            order = np.random.default_rng((turn, _digest(f"{group} {self.key}"))).permutation(len(self.choices))
            return self.choices[int(order[place])]
        rng = np.random.default_rng((seed, _digest(f"{label(world)} {self.key}")))
        if DRAWN_KEYS[self.key] is SimulatorOptions and self.key == "beams":
            return str(int(rng.integers(round(self.low), round(self.high) + 1)))
        return repr(float(rng.uniform(self.low, self.high)))


def _place_in_turn(world: str) -> tuple[str, int]:
    """The worlds that share the turns of a world, and its place among them."""
    if (kind := family(world)) is None:
        return label(world), 0
    return kind, GeneratedName.parse(world).seed


def _digest(text: str) -> int:
    return zlib.crc32(text.encode())


def parse_draws(texts: Sequence[str], simulator: SimulatorOptions) -> list[Draw]:
    """The draws of a command line, each tried once at both ends; ValueError where one is no setting or no value."""
    draws = [Draw.parse(text) for text in texts]
    if len({draw.key for draw in draws}) < len(draws):
        raise ValueError(f"--draw names a key twice: {', '.join(draw.key for draw in draws)}")
    for draw in draws:
        for value in draw.choices or (repr(draw.low), repr(draw.high)):
            text = str(round(float(value))) if draw.key == "beams" and not draw.choices else value
            with_value(simulator, draw.key, text, "--draw")
    return draws


def with_each_choice(simulator: SimulatorOptions, draws: Sequence[Draw], key: str) -> list[SimulatorOptions]:
    """The settings with each value that may be drawn for `key`; as they are where it is not drawn."""
    choices = [value for draw in draws if draw.key == key for value in draw.choices]
    return [with_value(simulator, key, value, "--draw") for value in choices] or [simulator]


def drawn(
    simulator: SimulatorOptions, draws: Sequence[Draw], world: str, seed: int
) -> tuple[SimulatorOptions, dict[str, Any]]:
    """The settings for a world and a seed, and the values that were drawn by key.

    world: name or file, as `worlds.load` takes it
    """
    values = {}
    for draw in draws:
        simulator = with_value(simulator, draw.key, draw.value(world, seed), "--draw")
        values[draw.key] = value_of(simulator, draw.key)
    return simulator, values


def draws_of_config(config: Path | None, simulator: SimulatorOptions, seed: int) -> dict[str, Any]:
    """The values that were drawn for the dataset whose config.toml is used again, by key; those that the command line
    or another seed replaces are no draws any more."""
    if config is None or not config.is_file():
        return {}
    document = tomllib.loads(config.read_text(encoding="utf-8"))
    if document.get("settings", {}).get("seed") != seed:
        return {}
    draws = document.get("draws", {})
    return {key: value for key, value in draws.items() if key in DRAWN_KEYS and value_of(simulator, key) == value}
