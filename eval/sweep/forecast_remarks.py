# SPDX-License-Identifier: MIT
"""What `testbed sweep --suggest` forecasts for the worlds of a sweep, and whether the runs contradict it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.sweep.answer_words import counted, difference_words
from eval.sweep.needed_count import MAX_RATIO, PREDICTORS, NeededCount, of_ten, predictors_of, shipped_model
from eval.sweep.remarks import MAX_NAMED
from eval.sweep.results import SweepTable
from eval.sweep.statistics import min_values
from eval.sweep.summary import SweepSummary


@dataclass(frozen=True)
class Forecast:
    """What `testbed sweep --suggest` says for the drives of these worlds; both empty where it says nothing."""

    counts: str = ""
    """`start with about 11 in loop and about 7 in apartment; each is enough in 9 of 10 worlds like it; of such worlds
    95 % need 2 to 25 in loop and 1 to 20 in apartment`"""
    unlike: str = ""
    """Which drives are unlike those of the experiment, and in what."""


def suggested_counts(table: SweepTable) -> Forecast:
    """What `testbed sweep --suggest` says for the drives of these worlds; nothing for logs and other filters."""
    columns = [table.columns.get(f"features.{predictor.name}") for predictor in PREDICTORS]
    if table.baseline != "default" or table.measure.estimate != "filter" or any(c is None for c in columns):
        return Forecast()
    model = shipped_model()
    drives = {place: own for place in table.places if len(own := _drives(table, place))}
    if not 0 < len(drives) <= MAX_NAMED:
        return Forecast()
    usual = {place: _usual_predictors(own) for place, own in drives.items()}
    starts = {place: model.start(at) for place, at in usual.items()}
    chances = {place: of_ten(model.chance(at, starts[place])) for place, at in usual.items()}
    if len(set(chances.values())) == 1:
        each = f"{'each is ' if len(chances) > 1 else ''}enough in {next(iter(chances.values()))} worlds like it"
        counts = f"start with {_listed(f'about {starts[place]} in {place}' for place in drives)}; {each}"
    else:
        words = (f"about {starts[place]} in {place} (enough in {chances[place]} worlds like it)" for place in drives)
        counts = f"start with {_listed(words)}"
    needs = (f"{_range(model, usual[place])} in {place}" for place in drives)
    counts += f"; of such worlds 95 % need {_listed(needs)}"
    unlike = (_unlike(model, place, own) for place, own in drives.items())
    return Forecast(counts, " ".join(filter(None, unlike)))


def _range(model: NeededCount, at: NDArray[np.float64]) -> str:
    """The counts that 95 % of the worlds like this need: `2 to 25`, `4 to more than 30`."""
    low, high = (f"more than {model.max_count}" if end is None else f"{end}" for end in model.interval(at))
    return low if low == high else f"{low} to {high}"


def _listed(words: Iterable[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def _unlike(model: NeededCount, place: str, drives: NDArray[np.float64]) -> str:
    """Which of the drives are unlike those of the experiment, and in what; empty if none is."""
    names = [predictor.name for predictor in PREDICTORS]
    of_drives = [model.outside(predictors_of(dict(zip(names, drive, strict=True)))) for drive in drives]
    number = sum(map(bool, of_drives))
    if not number:
        return ""
    words = " and in the ".join(dict.fromkeys(predictor.words for own in of_drives for predictor in own))
    return f"In {place} {number} of the {len(drives)} drives are unlike those of the experiment in the {words}."


@dataclass(frozen=True)
class ForecastCheck:
    """How the runs so far agree with the forecast of `suggested_counts`; both empty where they do."""

    shown: str = ""
    """Where the runs show that the forecast's count is too small."""
    so_far: str = ""
    """Where its error is larger so far than the forecast allows, which the runs do not show."""


def forecast_against_runs(summary: SweepSummary) -> ForecastCheck:
    """Compare the forecast with the runs so far, by the paired differences that decide the answers.

    The count that can contradict it is the forecast's, or the next larger one that was tested: that a smaller one is
    too small the forecast says itself.
    """
    table = summary.table
    if not suggested_counts(table).counts:
        return ForecastCheck()
    model, shown, so_far = shipped_model(), [], []
    for place in table.places:
        drives = _drives(table, place)
        start = model.start(_usual_predictors(drives)) if len(drives) else table.counts[-1]
        c = next((c for c, count in enumerate(table.counts) if count >= start), len(table.counts) - 1)
        if c == len(table.counts) - 1:
            continue
        not_run = f" ({start} {'was' if start == 1 else 'were'} not run)"
        name = f"{table.counts[c]}{'' if table.counts[c] == start else not_run}"
        state = summary.decision(place, table.baseline).states[c]
        if state == "worse":
            shown.append(f"in {place} {name} {_shown_worse(summary, place, c)}")
        elif state == "open" and (words := _worse_so_far(summary, place, c)):
            so_far.append(f"in {place} the error with {name} is so far {words}")
    follow = "Follow the runs, that is the cards: the forecast knows other worlds only."
    return ForecastCheck(
        f"The runs say otherwise: {'; '.join(shown)}. {follow}" if shown else "",
        f"{so_far[0][0].upper()}{'; '.join(so_far)[1:]}." if so_far else "",
    )


def _shown_worse(summary: SweepSummary, place: str, c: int) -> str:
    """By how much a count is shown to be worse than the largest one, by its error or by failures; c: its index."""
    table, decision = summary.table, summary.decision(place, summary.table.baseline)
    difference, largest = decision.differences[c], table.counts[-1]
    are = "is" if table.counts[c] == 1 else "are"
    if difference.count >= min_values(table.level) and difference.low > decision.limits[c]:
        unit = table.measure.unit(summary.group(place, table.baseline, largest).median.value)
        return f"{are} shown to be worse than {largest}, by {difference_words(difference, unit)}"
    own, other = (summary.group(place, table.baseline, count) for count in (table.counts[c], largest))
    return (
        f"{are} shown to fail more often than {largest}, in {own.failures} of {own.runs} runs against "
        f"{other.failures} of {other.runs}"
    )


def _worse_so_far(summary: SweepSummary, place: str, c: int) -> str:
    """How much larger than the forecast allows the error of an open count is, and why that shows nothing; empty where
    it is not."""
    table, decision = summary.table, summary.decision(place, summary.table.baseline)
    difference, largest = decision.differences[c], table.counts[-1]
    share = difference.value / summary.group(place, table.baseline, largest).median.value
    if not share > MAX_RATIO - 1.0:  # NaN without results
        return ""
    said = f"{100.0 * share:.0f} % above that with {largest} in the median pair of runs"
    if difference.count < min_values(table.level):
        return f"{said}, but {counted(difference.count, 'seed')} cannot tell"
    if difference.contains(0.0):
        return f"{said}, which chance may explain"
    return f"{said}, which is not shown to be more than the margin"


def _drives(table: SweepTable, place: str) -> NDArray[np.float64]:
    """The known features of the drives of the baseline in one place, (drives, predictors)."""
    p, base = table.places.index(place), table.lines.index(table.baseline)
    drives = np.stack([table.cube(f"features.{predictor.name}")[p, base, 0] for predictor in PREDICTORS], axis=-1)
    known: NDArray[np.float64] = drives[np.isfinite(drives).all(axis=-1)]
    return known


def _usual_predictors(drives: NDArray[np.float64]) -> NDArray[np.float64]:
    """The predictors of the median drive."""
    names = [predictor.name for predictor in PREDICTORS]
    return predictors_of(dict(zip(names, np.median(drives, axis=0).tolist(), strict=True)))
