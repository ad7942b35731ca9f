# SPDX-License-Identifier: MIT
"""How long further jobs of a sweep take, by the times of those that are done."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from eval.sweep.results import SweepTable

REPORT_SECONDS = 8.0
"""Typical time to start the workers and to make tables and report [s]."""


def seconds_per_seed(table: SweepTable, place: str) -> float:
    """Time of one core for all lines and counts of one more seed [s]; NaN if nothing was measured."""
    seconds = table.cube("cell_s")[table.places.index(place)]
    known = seconds[np.isfinite(seconds)]
    if not len(known):
        return math.nan
    of_group = [row[np.isfinite(row)] for row in seconds.reshape(-1, seconds.shape[-1])]
    return sum(float(np.mean(row if len(row) else known)) for row in of_group)


def seconds_for_seeds(table: SweepTable, places: Iterable[str], seeds: int, workers: int) -> float:
    """Time until each of these places has `seeds` seeds and the report is there [s]; NaN if it is unknown."""
    there = table.ran.any(axis=(1, 2)).sum(axis=-1)
    work = sum(
        seconds_per_seed(table, place) * max(seeds - int(there[table.places.index(place)]), 0) for place in places
    )
    return work / workers + REPORT_SECONDS


def duration_words(seconds: float) -> str:
    """`10 s`, `8 minutes`, `3 hours`, `2 days`; `an unknown time` for NaN."""
    if math.isnan(seconds):
        return "an unknown time"
    for unit, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 1.7 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{10 * math.ceil(max(seconds, 1.0) / 10):.0f} s"
