# SPDX-License-Identifier: MIT
"""Sentences about what is not the answer: what seeds change, real time, and whether the filter trusts itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eval.sweep.results import SweepTable
from eval.sweep.summary import SweepSummary

FIXED = "all seeds drive the same route, with other noise"
MIN_INSIDE = 0.8
"""A filter whose 95 % ellipsoid holds the truth in less than this share of the updates is called overconfident."""


def seeds_change(table: SweepTable) -> str:
    """What distinguishes the runs of different seeds."""
    if table.recorded:
        return "seeds change the random numbers of the filter only"
    routes = {str(route) for route in table.columns.get("setting.route", np.array([None], dtype=object)).ravel()}
    if routes <= {"random", "stops"}:
        return "each seed drives another route through the whole world"
    return "some filters drive another route with each seed" if routes - {"fixed", "None"} else FIXED


def described(table: SweepTable) -> str:
    """What the runs of a sweep have in common, for captions: routes, robot, lidar, odometry and further settings."""
    parts = filter(None, (seeds_change(table), table.conditions))
    return " ".join(f"{part[0].upper()}{part[1:]}." for part in parts)


def real_time(summary: SweepSummary) -> str:
    """How many times as fast as the drive the filter computes, for each count; empty if it is unknown.

    The slowest world or log counts. The time is that of the filter alone, on one core, as sweeps compute their runs.
    """
    table = summary.table
    base = table.lines.index(table.baseline)
    factors = table.cube("duration_s")[:, base] / table.cube("filter_s")[:, base]  # (places, counts, seeds)
    known = [(count, _slowest(factors[:, c])) for c, count in enumerate(table.counts)]
    known = [(count, factor) for count, factor in known if np.isfinite(factor)]
    if not known:
        return ""
    counts = ", ".join(str(count) for count, _ in known)
    speeds = ", ".join(_rounded(factor) for _, factor in known)
    where = "" if len(table.places) == 1 else " in the slowest world"
    slow = ", ".join(str(count) for count, factor in known if factor < 1.0)
    return (
        f"With {counts} particles the filter alone computes {speeds} times as fast as the robot drives, "
        f"on one core{where}: " + (f"{slow} are too many for real time." if slow else "all of them in real time.")
    )


def overconfidence(summary: SweepSummary) -> str:
    """Whether the covariance of the baseline can be trusted, by the smallest and the largest count; empty if it can."""
    table = summary.table
    base = table.lines.index(table.baseline)
    inside = table.cube("filter.consistency.inside_share")[:, base]
    largest = _ends(inside[:, -1])
    if largest is None or largest[0] >= MIN_INSIDE:
        return ""
    smallest = _ends(inside[:, 0])
    least = "" if smallest is None or len(table.counts) == 1 else f"{_range(smallest)} with {table.counts[0]} and at "
    by_world = ", by world" if len(table.places) > 1 else ""
    return (
        "The filter is overconfident: at 95 % of the updates the true pose should lie inside its 95 % ellipsoid; "
        f"it does at {least}{_range(largest)} with {table.counts[-1]} particles{by_world}."
    )


def _slowest(factors: NDArray[np.float64]) -> float:
    """Smallest median over the seeds, of factors (places, seeds); NaN if none is known."""
    medians = [float(np.median(row[np.isfinite(row)])) for row in factors if np.isfinite(row).any()]
    return min(medians, default=np.nan)


def _ends(shares: NDArray[np.float64]) -> tuple[float, float] | None:
    """Smallest and largest median over the seeds, of shares (places, seeds); None if none is known."""
    medians = [float(np.median(row[np.isfinite(row)])) for row in shares if np.isfinite(row).any()]
    return (min(medians), max(medians)) if medians else None


def _range(ends: tuple[float, float]) -> str:
    low, high = (f"{100.0 * end:.0f}" for end in ends)
    return f"{low} %" if low == high else f"{low} to {high} %"


def _rounded(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 10.0 else f"{factor:.1f}"
