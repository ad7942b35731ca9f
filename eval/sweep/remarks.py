# SPDX-License-Identifier: MIT
"""Sentences about what is not the answer: what seeds change, real time, and whether the filter trusts itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eval.sweep.answers import particles
from eval.sweep.margin import Margin
from eval.sweep.results import SweepTable
from eval.sweep.summary import SweepSummary

FIXED = "all seeds drive the same route, with other noise"
MAX_NAMED = 3
"""At most so many worlds are named in a sentence."""
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
    """Whether the covariance of the baseline can be trusted, by the largest count; empty if it can."""
    table = summary.table
    base = table.lines.index(table.baseline)
    inside = table.cube("filter.consistency.inside_share")[:, base]
    shares = [row[np.isfinite(row)] for row in inside[:, -1]]
    known = [(float(np.median(row)), place) for row, place in zip(shares, table.places, strict=True) if len(row)]
    if not known or min(known)[0] >= MIN_INSIDE:
        return ""
    if len(table.places) == 1:
        where = f"{100.0 * known[0][0]:.0f} %"
    elif len(known) <= MAX_NAMED:
        where = " and ".join(f"{100.0 * share:.0f} % ({place})" for share, place in sorted(known))
    else:
        where = f"{100.0 * min(known)[0]:.0f} to {100.0 * max(known)[0]:.0f} %, by world"
    return (
        "The filter is overconfident: at 95 % of the updates the true pose should lie inside its 95 % ellipsoid; "
        f"with {particles(table.counts[-1])} it does at {where}."
    )


def margin_words(summary: SweepSummary) -> str:
    """The margin that counts in each world: `5 mm`, or with the worlds where the share of the error is larger."""
    table = summary.table
    decisions = {place: summary.decision(place, table.baseline) for place in table.places}
    shares = [place for place, d in decisions.items() if np.isfinite(d.limit) and d.limit > table.margin.floor]
    share = f"{100.0 * table.margin.share:g} %"
    if not table.margin.floor or len(shares) == len(decisions):
        return share
    floor = Margin(0.0, table.margin.floor).words(is_length=table.measure.key.endswith("_m"))
    if not table.margin.share or not shares:
        return floor
    return (
        f"{floor} ({share} where that is more: {', '.join(shares)})" if len(shares) <= MAX_NAMED else table.margin_words
    )


def _slowest(factors: NDArray[np.float64]) -> float:
    """Smallest median over the seeds, of factors (places, seeds); NaN if none is known."""
    medians = [float(np.median(row[np.isfinite(row)])) for row in factors if np.isfinite(row).any()]
    return min(medians, default=np.nan)


def _rounded(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 10.0 else f"{factor:.1f}"
