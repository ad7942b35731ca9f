# SPDX-License-Identifier: MIT
"""Lists of seeds as the command line and TOML files write them: `10`, `0,1,2`, `0:10`, or several of these."""

from __future__ import annotations

import re

MAX_SEEDS = 10_000
"""Largest number of seeds in a sweep."""
MAX_SEED = 2**63 - 1
"""Largest seed."""
_RANGE = re.compile(r"(\d{1,19}):(\d{1,19})")
_EXPECTED = "expected a number of seeds such as 10, a list such as 0,1,2, or a range such as 0:10"


def seeds_of_count(count: int) -> tuple[int, ...]:
    """The seeds 0 to count - 1; raises ValueError for more than `MAX_SEEDS` and for a negative number."""
    if not 0 <= count <= MAX_SEEDS:
        raise ValueError(f"{count} seeds, expected 1 to {MAX_SEEDS}")
    return tuple(range(count))


def parse_seeds(text: str) -> tuple[int, ...]:
    """Parse a list of seeds. A single number is how many, from 0 on; `a:b` are the seeds a to b - 1.

    Raises ValueError in one line for other text, for seeds above `MAX_SEED` and for more than `MAX_SEEDS` seeds.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if len(words) == 1 and "," not in text and words[0].isdecimal():
        return seeds_of_count(int(words[0]))
    seeds: list[int] = []
    for word in words:
        span = _RANGE.fullmatch(word)
        if span is None and not (word.isdecimal() and len(word) <= 19):
            raise ValueError(f"{text}: {_EXPECTED}")
        first, end = (int(span[1]), int(span[2])) if span else (int(word), int(word) + 1)
        if first >= end or end - 1 > MAX_SEED:
            raise ValueError(f"{word} holds {'no seed' if first >= end else f'a seed above {MAX_SEED}'}")
        if len(seeds) + end - first > MAX_SEEDS:
            raise ValueError(f"{text}: more than {MAX_SEEDS} seeds")
        seeds += range(first, end)
    if not seeds:
        raise ValueError(f"{text!r}: {_EXPECTED}")
    return tuple(seeds)
