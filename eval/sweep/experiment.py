# SPDX-License-Identifier: MIT
"""The runs of a designed experiment from its sweep, what they say by level, and predictions for held-out worlds."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from eval.sweep.needed_count import MAX_LOSS, MAX_RATIO, MIN_HOLDING, PREDICTORS, START, NeededCount, Runs, fit
from eval.sweep.results import SweepTable, SweepTableError

SIMULATED = 2000
"""Worlds that are simulated to predict what is observed in one."""


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
    """A held-out world: what the model predicts that was fitted to others, and what was observed."""

    place: str
    drives: int
    counts: tuple[int, ...]
    predicted: NDArray[np.float64]
    """Predicted share of the runs that hold, by count."""
    observed: NDArray[np.float64]
    """Observed share, by count."""
    needed_predicted: NDArray[np.float64]
    """What would be observed as needed in worlds like it, with as many drives, in ascending order; infinite = not even
    the largest tested count holds."""
    needed_observed: float
    """Smallest tested count that is as good as the largest; infinite = not even the largest one holds."""
    start: float
    """Count to start with in this world; infinite = more than the largest one."""

    def quantile(self, share: float) -> float:
        """The tested count that is predicted to be enough in this share of such worlds."""
        return float(self.needed_predicted[math.ceil(share * len(self.needed_predicted)) - 1])

    def is_within(self, share: float) -> bool:
        """Whether what was needed lies in the range that is predicted for this share of such worlds."""
        low, high = self.range(share)
        return low <= self.needed_observed <= high

    def range(self, share: float) -> tuple[float, float]:
        """The range of tested counts that is predicted for this share of such worlds, or more."""
        return self.quantile(0.5 - share / 2), self.quantile(0.5 + share / 2)

    def chance_within(self, share: float) -> float:
        """The predicted chance of `is_within`: more than `share`, since ranges end at tested counts."""
        low, high = self.range(share)
        return float(((low <= self.needed_predicted) & (self.needed_predicted <= high)).mean())

    @property
    def is_too_small(self) -> bool:
        """Whether the count to start with, or the next one that was tested, was less than what was needed."""
        return self._tested_start < self.needed_observed

    @property
    def chance_too_small(self) -> float:
        """The predicted chance of `is_too_small`: what is observed in a few drives is uncertain too."""
        return float((self.needed_predicted > self._tested_start).mean())

    @property
    def _tested_start(self) -> float:
        return min((count for count in self.counts if count >= self.start), default=math.inf)


def predict_held_out(runs: Runs, places: Sequence[str]) -> list[HeldOut]:
    """Hold out each world in turn, fit the model to the others, and predict it."""
    found = []
    for world in np.unique(runs.world):
        others, own = runs.of(runs.world != world), runs.of(runs.world == world)
        found.append(predicted(fit(others, {}), own, places[int(world)]))
    return found


def predicted(model: NeededCount, own: Runs, place: str) -> HeldOut:
    """Predict the runs of a world that the model was not fitted to; each of its drives has runs with all counts."""
    counts, drives = np.unique(own.particles), np.unique(own.drive)
    rows = np.lexsort((own.particles, own.drive))
    shape = (len(drives), len(counts))
    own = own.of(rows)
    held, errors = own.holds.reshape(shape), np.where(own.holds, own.error, np.nan).reshape(shape)
    at = own.predictors.reshape(*shape, -1)[:, 0]
    holds, logs = _simulated(model, counts, at)
    start = model.quantile(np.median(at, axis=0), START)
    return HeldOut(
        place=place,
        drives=len(drives),
        counts=tuple(counts.tolist()),
        predicted=holds.mean(axis=(0, 1)),
        observed=held.mean(axis=0),
        needed_predicted=np.sort(_needed(counts, holds, np.where(holds, logs, np.nan))),
        needed_observed=float(_needed(counts, held[None], np.log(errors)[None])[0]),
        start=math.inf if start is None else float(start),
    )


def _simulated(
    model: NeededCount, counts: NDArray[np.int64], at: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether runs hold, and their log errors up to a constant, (worlds, drives, counts), in `SIMULATED` worlds.

    at: predictors of the drives (drives, p). Each world has a draw of the parameters and effects of its own.
    """
    rng = np.random.default_rng(0)
    rows = rng.integers(1, len(model.holding), SIMULATED)
    x = at - model.centre
    odds = model.holding[rows, :1] + model.holding[rows, 2:] @ x.T
    odds += model.holding_spread[rows, :1] * rng.standard_normal((SIMULATED, 1))
    odds += model.holding_spread[rows, 1:] * rng.standard_normal(odds.shape)
    log_odds = odds[:, :, None] + model.holding[rows, 1][:, None, None] * np.log2(counts)
    holds = rng.random(log_odds.shape) < expit(log_odds)
    slope = model.growth[rows, :1] + model.growth[rows, 1:] @ x.T
    slope += model.growth_spread[rows, :1] * rng.standard_normal((SIMULATED, 1))
    noise = model.growth_spread[rows, 1][:, None, None] * rng.standard_normal(holds.shape)
    return holds, slope[:, :, None] * counts**-0.5 + noise


def _needed(counts: NDArray[np.int64], holds: NDArray[np.bool_], logs: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is observed as needed in each world: the smallest count from which on all are as good as the largest one.

    holds, logs: (worlds, drives, counts); logs: log errors, NaN for runs that do not hold.
    """
    shares = holds.mean(axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # no drive that holds with both counts
        ratios = np.nan_to_num(np.nanmedian(logs - logs[:, :, -1:], axis=1))
    enough = (shares >= shares[:, -1:] - MAX_LOSS - 1e-9) & (ratios <= math.log(MAX_RATIO))
    from_here = np.logical_and.accumulate(enough[:, ::-1], axis=1)[:, ::-1]
    needed: NDArray[np.float64] = counts[np.argmax(from_here, axis=1)].astype(np.float64)
    needed[shares[:, -1] < MIN_HOLDING] = math.inf
    return needed


def brier_score(found: Sequence[HeldOut]) -> tuple[float, float]:
    """Mean squared error of the predicted shares, and that of predicting every world by the mean of the others."""
    observed = np.array([world.observed for world in found])
    predicted = np.array([world.predicted for world in found])
    others = (observed.sum(axis=0) - observed) / max(len(found) - 1, 1)
    return float(np.mean((predicted - observed) ** 2)), float(np.mean((others - observed) ** 2))
