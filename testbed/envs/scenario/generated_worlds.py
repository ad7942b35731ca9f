# SPDX-License-Identifier: MIT
"""Generated worlds, split into worlds to train in and worlds to test in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from numpy.random import Generator

from testbed.seeds import world_stream
from worlds import KINDS, World, generate

Split = Literal["train", "test"]
MAX_WORLDS = 2**31
"""Number of worlds in a split whose count is not limited."""


@dataclass(frozen=True, kw_only=True)
class GeneratedWorlds:
    """Worlds by number, of kinds that take turns. The splits "train" and "test" have no world in common."""

    kinds: tuple[str, ...] = ("rooms",)
    """Kinds as in `worlds.generate`; world number n is of kind n modulo their count."""
    size: tuple[float, float] = (12.0, 10.0)
    """Width and depth [m]."""
    clutter: float = 0.5
    """Objects per 10 m² of floor."""
    loops: int = 2
    """Number of additional openings, each of which closes a loop."""
    split: Split = "train"
    """The split that the worlds are taken from."""
    count: int | None = None
    """Number of worlds in the split; None = `MAX_WORLDS`."""

    def __post_init__(self) -> None:
        if not self.kinds or not set(self.kinds) <= set(KINDS):
            raise ValueError(f"kinds must be some of {', '.join(KINDS)}, got {', '.join(self.kinds) or 'none'}")
        if self.split not in get_args(Split):
            raise ValueError(f"split must be one of {', '.join(get_args(Split))}, got {self.split!r}")
        if self.count is not None and not 1 <= self.count <= MAX_WORLDS:
            raise ValueError(f"count must be 1 to {MAX_WORLDS}, got {self.count}")
        self.world(0)  # complains about size, clutter and loops

    def draw(self, rng: Generator) -> int:
        """Return the number of a random world."""
        return int(rng.integers(self.count or MAX_WORLDS))

    def world(self, number: int) -> World:
        """Return the world of that number, always the same. Raises `ValueError` for a number out of range."""
        if not 0 <= number < (self.count or MAX_WORLDS):
            raise ValueError(f"world number must be 0 to {(self.count or MAX_WORLDS) - 1}, got {number}")
        world = generate(
            self.kinds[number % len(self.kinds)],  # type: ignore[arg-type]  # checked on creation
            size=self.size,
            clutter=self.clutter,
            loops=self.loops,
            seed=world_stream(number, get_args(Split).index(self.split)),
        )
        return world.model_copy(update={"name": f"{world.name} {self.split} {number}"})
