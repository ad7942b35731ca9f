# SPDX-License-Identifier: MIT
"""How long further jobs of a sweep take, by the times of those that are done."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from eval.sweep.results import LEFT_OUT, SweepTable

REPORT_SECONDS = 8.0
"""Typical time to start the workers and to make tables and report [s]."""


def seconds_for_seeds(table: SweepTable, places: Iterable[str], seeds: int, workers: int) -> float:
    """Time until each of these places has `seeds` seeds and the report is there [s]; NaN if it is unknown.

    Runs that are left out of the answers are there all the same.
    """
    there = (table.ran | (table.columns["status"].astype(str) == LEFT_OUT)).sum(axis=-1)  # (places, lines, counts)
    work = 0.0
    for p in map(table.places.index, places):
        work += float((_seconds_of_jobs(table, p) * np.maximum(seeds - there[p], 0)).sum())
    return work / workers + REPORT_SECONDS


def _seconds_of_jobs(table: SweepTable, p: int) -> NDArray[np.float64]:
    """Mean time of one core for a job of place number p by line and count [s], (lines, counts).

    That of all jobs of the place where none was measured; NaN if none was measured at all.
    """
    seconds = table.cube("cell_s")[p]
    known = seconds[np.isfinite(seconds)]
    usual = float(np.mean(known)) if len(known) else math.nan
    groups = [row[np.isfinite(row)] for row in seconds.reshape(-1, seconds.shape[-1])]
    means = [float(np.mean(group)) if len(group) else usual for group in groups]
    return np.array(means).reshape(seconds.shape[:-1])


def duration_words(seconds: float) -> str:
    """`10 s`, `8 minutes`, `3 hours`, `2 days`; `an unknown time` for NaN."""
    if math.isnan(seconds):
        return "an unknown time"
    for unit, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 1.7 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{10 * math.ceil(max(seconds, 1.0) / 10):.0f} s"
