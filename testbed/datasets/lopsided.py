# SPDX-License-Identifier: MIT
"""Splits whose parts differ much from 70, 15 and 15 % of the driving time: why, and which worlds to choose instead."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from testbed.datasets.index import SPLITS, natural_order, splits

MIN_TRAIN_SHARE = 0.5
"""Share of the driving time that is for training; below it the split is called lopsided."""
MIN_GAIN = 0.05
"""Another choice is named where it gives training so much more of the driving time."""


def time_shares(seconds: Mapping[str, float], of_world: Mapping[str, str]) -> str:
    """How much of the driving time each split has, as in `of the driving time: train 24 %, validation 0 %, test 76 %`.

    seconds: driving time of each world [s]
    of_world: split of each world, see `testbed.datasets.index.splits`
    """
    shares = _shares(seconds, of_world)
    return "of the driving time: " + ", ".join(f"{split} {100.0 * share:.0f} %" for split, share in shares.items())


def lopsided(seconds: Mapping[str, float], of_world: Mapping[str, str], directory: Path) -> str:
    """What to do where most of the driving time is not for training; an empty text where training has enough.

    seconds, of_world: as for `time_shares`; directory: of the collection, for the command
    """
    share = _shares(seconds, of_world)["train"]
    if len(of_world) < 2 or share >= MIN_TRAIN_SHARE:
        return ""
    found = f"Lopsided: training has only {100.0 * share:.0f} % of the driving time, since a split has whole worlds"
    smallest, *others = sorted(of_world, key=lambda world: (seconds[world], natural_order(world)))
    choice = {smallest: "test"} | ({others[0]: "validation"} if len(others) > 1 else {})
    if _shares(seconds, splits(of_world, choice))["train"] < share + MIN_GAIN:
        return f"{found}. More worlds bring it nearer to 70 %."
    options = " ".join(f"--{split} {world}" for world, split in choice.items())
    return (
        f"{found} and these differ in size. More worlds bring it nearer to 70 %; or keep the smallest for testing: "
        f"`testbed datasets index {directory} {options}`."
    )


def _shares(seconds: Mapping[str, float], of_world: Mapping[str, str]) -> dict[str, float]:
    """Share of the driving time in each split."""
    everything = sum(seconds[world] for world in of_world) or 1.0
    return {
        split: sum(seconds[world] for world, its_split in of_world.items() if its_split == split) / everything
        for split in SPLITS
    }
