# SPDX-License-Identifier: MIT
"""The runs of a designed experiment from its sweep, what they say by level, and predictions for held-out worlds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eval.sweep.needed_count import MAX_LOSS, MAX_RATIO, MIN_HOLDING, PREDICTORS, NeededCount, Runs, fit
from eval.sweep.results import SweepTable, SweepTableError


def runs_of(table: SweepTable) -> Runs:
    """The runs of a sweep that have a result or failed; raises SweepTableError if it lacks the features."""
    missing = [p.name for p in PREDICTORS if f"features.{p.name}" not in table.columns]
    if missing:
        raise SweepTableError(f"the sweep has no features {', '.join(missing)}: expected one over worlds")
    features = [_of_the_drive(table.cube(f"features.{p.name}")) for p in PREDICTORS]
    rows: list[tuple[int, int, int, list[float], bool, float]] = []
    places, lines, counts, seeds = map(range, table.shape)
    for p, k, c, s in product(places, lines, counts, seeds):
        values = [float(feature[p, k, s]) for feature in features]
        if not table.ran[p, k, c, s] or not np.isfinite(values).all():
            continue
        drive = (p * len(lines) + k) * len(seeds) + s
        transformed = [q.value({q.name: value}) for q, value in zip(PREDICTORS, values, strict=True)]
        error = float(table.error[p, k, c, s])
        rows.append((p, drive, table.counts[c], transformed, not table.failed[p, k, c, s], error))
    if not rows:
        raise SweepTableError("the sweep has no run with a result, expected a finished experiment")
    world, drive_, particles, predictors, holds, errors = map(np.array, zip(*rows, strict=True))
    return Runs(world, drive_, particles, predictors, holds.astype(np.bool_), errors)


def joined(parts: Sequence[Runs]) -> Runs:
    """The runs of several parts of an experiment, with worlds and drives numbered on; of each part only the drives that
    were computed with all counts, so that a part need not be finished."""
    whole = [_complete_drives(part) for part in parts]
    columns = {name: [getattr(part, name) for part in whole] for name in vars(parts[0])}
    for name in ("world", "drive"):
        first = np.cumsum([0, *(int(getattr(part, name).max(initial=-1)) + 1 for part in parts[:-1])])
        columns[name] = [numbers + start for numbers, start in zip(columns[name], first, strict=True)]
    return Runs(**{name: np.concatenate(values) for name, values in columns.items()})


def _complete_drives(runs: Runs) -> Runs:
    counts = len(np.unique(runs.particles))
    drives, found = np.unique(runs.drive, return_counts=True)
    return runs.of(np.isin(runs.drive, drives[found == counts]))


def _of_the_drive(cube: NDArray[np.float64]) -> NDArray[np.float64]:
    """A feature by place, line and seed; all counts of a drive have the same one, failed jobs have none."""
    known = np.isfinite(cube)
    total = np.where(known, cube, 0.0).sum(axis=2)
    with np.errstate(invalid="ignore"):
        mean: NDArray[np.float64] = total / known.sum(axis=2)
    return mean


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A held-out world: what the model predicts that was fitted to the others, and what was observed."""

    place: str
    drives: int
    counts: tuple[int, ...]
    predicted: NDArray[np.float64]
    """Predicted share of the runs that hold, by count."""
    observed: NDArray[np.float64]
    """Observed share, by count."""
    needed_predicted: int | None
    """Smallest tested count that is predicted to be as good as the largest; None = not even the largest one holds."""
    needed_observed: int | None

    @property
    def is_too_small(self) -> bool:
        """Whether fewer particles are predicted than were needed."""
        predicted, observed = (math.inf if n is None else n for n in (self.needed_predicted, self.needed_observed))
        return predicted < observed


def predict_held_out(runs: Runs, places: Sequence[str]) -> list[HeldOut]:
    """Hold out each world in turn, fit the model to the others, and predict it."""
    found = []
    for world in np.unique(runs.world):
        others, own = runs.of(runs.world != world), runs.of(runs.world == world)
        found.append(_predicted(fit(others, {}, resamples=0), own, places[int(world)]))
    return found


def _predicted(model: NeededCount, own: Runs, place: str) -> HeldOut:
    counts = np.unique(own.particles)
    at = [own.particles == count for count in counts]
    predicted = np.array([model.holds(own.particles[m], own.predictors[m]).mean() for m in at])
    observed = np.array([own.holds[m].mean() for m in at])
    ratios = np.array([np.median(model.error_ratio(own.particles[m], own.predictors[m])) for m in at])
    return HeldOut(
        place=place,
        drives=len(np.unique(own.drive)),
        counts=tuple(counts.tolist()),
        predicted=predicted,
        observed=observed,
        needed_predicted=_smallest(counts, predicted, ratios),
        needed_observed=_smallest(counts, observed, _observed_ratios(own, counts)),
    )


def _observed_ratios(own: Runs, counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Median over drives of the error relative to the largest count, where both hold; 1 where none does."""
    errors = np.full((len(counts), int(own.drive.max()) + 1), np.nan)
    rows = np.searchsorted(counts, own.particles)
    errors[rows, own.drive] = np.where(own.holds, own.error, np.nan)
    ratios = errors / errors[-1]
    return np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else 1.0 for row in ratios])


def _smallest(counts: NDArray[np.int64], holds: NDArray[np.float64], ratios: NDArray[np.float64]) -> int | None:
    """The smallest count from which on all are as good as the largest; None if not even that one holds."""
    if holds[-1] < MIN_HOLDING:
        return None
    enough = (holds >= holds[-1] - MAX_LOSS - 1e-9) & (ratios <= MAX_RATIO)
    good = int(np.argmin(enough[::-1])) if not enough.all() else len(enough)
    return int(counts[len(counts) - max(good, 1)])


def brier_score(found: Sequence[HeldOut]) -> tuple[float, float]:
    """Mean squared error of the predicted shares, and that of predicting every world by the mean of the others."""
    observed = np.array([world.observed for world in found])
    predicted = np.array([world.predicted for world in found])
    others = (observed.sum(axis=0) - observed) / max(len(found) - 1, 1)
    return float(np.mean((predicted - observed) ** 2)), float(np.mean((others - observed) ** 2))
