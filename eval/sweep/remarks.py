# SPDX-License-Identifier: MIT
"""Sentences about what is not the answer: looks, margin, seeds, the final pass, real time, overconfidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from eval.sweep.answer_words import MIN_INSIDE, after_seeds, difference_words, particles
from eval.sweep.decision import State
from eval.sweep.final_pass import after_the_final_pass
from eval.sweep.look_schedule import MIN_CHANCE, USUAL_LOOKS
from eval.sweep.margin import Margin, parse_margin, share_words
from eval.sweep.results import SweepTable
from eval.sweep.statistics import LEVEL, Interval, min_values
from eval.sweep.summary import SweepSummary

SAME = "the same route, with other noise"
MAX_NAMED = 3
"""At most so many worlds are named in a sentence."""


def seeds_change(table: SweepTable) -> str:
    """What distinguishes the runs of different seeds."""
    if table.recorded:
        return "seeds change the random numbers of the filter only"
    planned = table.columns["status"].astype(str) != "None"  # drawn worlds may have fewer seeds
    routes = {str(route) for route in table.columns.get("setting.route", np.full(table.shape, None))[planned]}
    cut = table.driven_share
    part = "" if cut is None else f"the first {100.0 * cut[0]:.0f} to {100.0 * cut[1]:.0f} % of "
    if routes <= {"random", "stops"}:
        return f"each seed drives {part}another route through the whole world"
    return (
        "some filters drive another route with each seed"
        if routes - {"fixed", "None"}
        else f"all seeds drive {part}{SAME}"
    )


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
    """Whether the covariance of the baseline can be trusted; empty if it can.

    With the count that is enough where one is known, else with the largest.
    """
    table = summary.table
    base = table.lines.index(table.baseline)
    inside = table.cube("filter.consistency.inside_share")[:, base]
    known: list[tuple[float, str, int]] = []
    for p, place in enumerate(table.places):
        decision = summary.decision(place, table.baseline)
        count = decision.count if decision.kind == "enough" and decision.count is not None else table.counts[-1]
        row = inside[p, table.counts.index(count)]
        row = row[np.isfinite(row)]
        if len(row):
            known.append((float(np.median(row)), place, count))
    low = [entry for entry in known if entry[0] < MIN_INSIDE]
    if not low:
        return ""
    if len(known) <= MAX_NAMED:
        where = " and ".join(f"{100.0 * share:.0f} % ({place}, {particles(count)})" for share, place, count in low)
    else:
        where = f"{100.0 * min(low)[0]:.0f} to {100.0 * max(low)[0]:.0f} %, by world"
    places = [place for _, place, _ in low]
    of = f" in {_named(places)}" if len(low) < len(known) else ""
    return (
        f"The filter is overconfident{of}: at 95 % of the updates the true pose should lie inside its 95 % ellipsoid; "
        f"it does at {where}."
    )


def never_resampled(summary: SweepSummary) -> str:
    """Where most runs of the baseline with the largest count never resampled; empty where there is no such world.

    There the particles are compared at the end only, when the best one is taken, and their number matters little.
    """
    table = summary.table
    largest, found = table.counts[-1], []
    for place in table.places:
        never, known = summary.never_resampled([place], table.baseline)
        if largest > 1 and 2 * never > known:
            found.append(f"{never} of {known} in {place}")
    if not found:
        return ""
    if len(found) > MAX_NAMED:
        found = [f"most in {len(found)} of {len(table.places)} worlds"]
    return (
        f"runs with {largest} particles that never resampled: {', '.join(found)}. Their particles were compared only "
        "at the end, when the best one is taken, so their number could matter little. Longer drives with loops ask "
        "more of it."
    )


def margin_words(summary: SweepSummary) -> str:
    """The margin that counts in each world, and which share of the error a length is there.

    `5 mm (loop 23 %, apartment 30 % of the error with 30)`; where the share is larger it stands alone: `museum 10 %`.
    """
    table = summary.table
    limits = {place: summary.decision(place, table.baseline).limit for place in table.places}
    limits = {place: limit for place, limit in limits.items() if np.isfinite(limit)}
    is_share = [limit > table.margin.floor for limit in limits.values()]
    if not table.margin.floor or (is_share and all(is_share)):
        return f"{100.0 * table.margin.share:g} %"
    floor = Margin(0.0, table.margin.floor).words(is_length=table.measure.key.endswith("_m"))
    largest = table.counts[-1]
    shares = {
        place: share_words(limit, float(summary.group(place, table.baseline, largest).median.value))
        for place, limit in limits.items()
    }
    named = [f"{place} {share}" for place, share in shares.items() if share]
    more = f"{100.0 * table.margin.share:g} % where that is more" if any(is_share) else ""
    if len(named) > MAX_NAMED:
        return f"{floor} ({more})" if more else floor
    of_error = f"{', '.join(named)} of the error with {largest}" if named else ""
    known = "; ".join(filter(None, (more, of_error)))
    return f"{floor} ({known})" if known else floor


def look_rule(table: SweepTable) -> str:
    """How often the results are looked at, with which intervals, and which look this is; empty for a single look."""
    looks = table.looks
    if not looks:
        return ""
    *earlier, last = map(str, looks)
    after = f"{', '.join(earlier)} and {last}" if earlier else last
    times = f"up to {len(looks)} times" if earlier else "once"
    ends = "it is known which count is the smallest" if table.until == "smallest" else "it has an answer"
    return (
        f"The results are looked at {times} (after {after} seeds), with {100.0 * table.level:.3g} % intervals, so that "
        f"the answers of up to {max(len(looks), USUAL_LOOKS)} looks at a world together hold with "
        f"{100.0 * LEVEL:.0f} % confidence (Bonferroni); the verdict on a count is final at the look where it falls. "
        f"A world gets no more seeds once {ends}, or where the chance of that is below {100.0 * MIN_CHANCE:.0f} %. "
        f"{_present_look(table)}{_left_words(table)}"
    )


def _left_words(table: SweepTable) -> str:
    """Which worlds the user gave up while their answers were open; empty for none."""
    summary = SweepSummary(table, ())
    left = [place for place in table.left if summary.decision(place, table.baseline).kind == "undecided"]
    if not left:
        return ""
    seeds = [f"{place} after {table.seeds_of(table.places.index(place))} seeds" for place in left]
    return f" By the user's decision, not by the rule, no more seeds were added in {', '.join(seeds)}."


def _present_look(table: SweepTable) -> str:
    """Which look the answers are from: `This is look 1, with 8 of at most 40 seeds.`"""
    look_of = {seeds: f"look {number}" for number, seeds in enumerate(table.looks, start=1)}
    seeds_of = {place: table.seeds_of(p) for p, place in enumerate(table.places)}
    numbers = sorted(set(seeds_of.values()))
    of = f"of at most {table.looks[-1]} seeds"
    if len(numbers) == 1:
        look = look_of.get(numbers[0])
        return "No look is complete yet." if look is None else f"This is {look}, with {numbers[0]} {of}."
    if len(seeds_of) > MAX_NAMED:
        return f"Here worlds have {numbers[0]} to {numbers[-1]} {of}."
    words = [
        f"{place} is at {look_of[seeds]} ({seeds} seeds)" if seeds in look_of else f"{place} has no complete look yet"
        for place, seeds in seeds_of.items()
    ]
    return f"{', '.join(words)}, {of}."


def margin_choice(table: SweepTable) -> str:
    """When the margin was changed after results had been seen; empty where it is the one that was planned."""
    if not table.margin_changes or parse_margin(table.margin_changes[0].before) == table.margin:
        return ""
    is_length = table.measure.key.endswith("_m")
    planned = parse_margin(table.margin_changes[0].before).words(is_length=is_length)
    seeds = table.margin_changes[-1].seeds
    look = f"look {table.looks.index(seeds) + 1}, with " if seeds in table.looks else ""
    return (
        f"The margin was changed from {planned} to {table.margin_words} after {look}{seeds} "
        f"seed{'' if seeds == 1 else 's'} had been seen, so the answers are no test of it."
    )


def after_final_pass(summary: SweepSummary) -> str:
    """What is left of the difference between the smallest and the largest count after the final pass; empty without
    one. That the count matters, or hardly does, is said where these runs show it."""
    table, final = summary.table, after_the_final_pass(summary.table)
    base, counts = table.lines.index(table.baseline), table.counts
    known: dict[str, tuple[float, float]] = {}
    states: dict[str, State] = {}
    differences: dict[str, Interval] = {}
    seeds: dict[str, str] = {}
    if final is None or len(counts) == 1:
        return ""
    for p, place in enumerate(table.places):
        decision = final.decision(place, table.baseline)
        few, many = (table.refined[p, base, c, decision.until_verdict(0)] for c in (0, -1))
        both = np.isfinite(few) & np.isfinite(many)
        if both.any():
            known[place] = float(np.median(few[both])), float(np.median(many[both]))
            seeds[place] = after_seeds(decision, 0, " in the first {} seeds")
            states[place], differences[place] = decision.states[0], decision.differences[0]
    if not known:
        return ""
    verdict = _final_verdict(states)
    unit = table.measure.unit(max(map(max, known.values())))
    ends = f"{{}} with {particles(counts[0])}, {{}} with {counts[-1]}"
    if len(known) <= MAX_NAMED:
        of_places = [
            f"{place} {ends.format(f'{unit.text(few)} {unit.name}'.strip(), unit.text(many))} (paired difference "
            f"{difference_words(differences[place], unit)}{seeds[place]})"
            for place, (few, many) in known.items()
        ]
        medians = "; ".join(of_places)
        if any(difference.count >= min_values() for difference in differences.values()):
            medians += f"; {100.0 * table.level:.3g} % intervals"
    else:
        ranges = [
            f"{unit.text(min(column))} to {unit.text(max(column))} {unit.name}".strip()
            for column in zip(*known.values(), strict=True)
        ]
        medians = f"{ends.format(*ranges)}, by world"
    return f"{verdict}: {medians}."


def _final_verdict(states: Mapping[str, State]) -> str:
    """Whether the count matters after the final pass; states: of the smallest count there, by world."""
    for state, words in (
        ("worse", "the count still matters"),
        ("good", "the smallest count does as well within the margin"),
    ):
        places = [place for place, own in states.items() if own == state]
        if places:
            return words + ("" if len(places) == len(states) else f" in {_named(places)}")
    return "it is not shown whether the count still matters"


def _named(places: Sequence[str]) -> str:
    return " and ".join(places) if len(places) <= MAX_NAMED else f"{len(places)} worlds"


def _slowest(factors: NDArray[np.float64]) -> float:
    """Smallest median over the seeds, of factors (places, seeds); NaN if none is known."""
    medians = [float(np.median(row[np.isfinite(row)])) for row in factors if np.isfinite(row).any()]
    return min(medians, default=np.nan)


def _rounded(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 10.0 else f"{factor:.1f}"
