# SPDX-License-Identifier: MIT
"""How the particle count that is needed grows with the drive: a model that is fitted to a designed experiment.

Two effects of the count are fitted, each with the features of the drive (`PREDICTORS`):

- that a run holds, that is, does not end lost or with a broken loop: logistic regression on log2(particles);
- the error of a run that holds: the log of its ratio to the error with the largest count is a straight line in
  1 / sqrt(particles), as Monte Carlo errors are, whose slope depends on the features (least squares).

A count is as good as the largest one if it holds at most `MAX_LOSS` less often, and its error is at most `MAX_RATIO`
times as large. Intervals come from a bootstrap over worlds, because drives of one world are alike (Davison, Hinkley,
"Bootstrap Methods and their Application", 1997, section 3.8). Both fits have a ridge penalty on the standardised slopes
(Hoerl, Kennard, Technometrics 12(1), 1970), since where all runs hold a logistic slope would be infinite.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

MAX_LOSS = 0.1
"""A count may hold in this share of the runs less often than the largest one."""
MAX_RATIO = 1.1
"""Its error may be larger by this factor, the share of `eval.sweep.margin`."""
MIN_HOLDING = 0.5
"""If the largest count holds less often than this, no tested count is said to be enough."""
RESAMPLES = 300
"""Bootstrap resamples of the worlds."""
_RIDGE = 1.0
"""Penalty on the squares of the standardised slopes [runs]."""
_MAX_LOG_RATIO = math.log(10.0)
"""Ratios of errors count as at most ten."""
_MAX_SLOPE = 2.0 * _MAX_LOG_RATIO
"""Slopes beyond it mean no more than that many particles are needed."""
DATA = "needed_count.json"
"""The fit that comes with the package; `python -m tools.measure.needed_count` writes it."""


@dataclass(frozen=True)
class Predictor:
    """A feature of a drive that the model uses."""

    name: str
    """Name of the feature."""
    words: str
    """What it is, for people."""
    unit: str
    floor: float
    """Smaller values count as this one: the model uses the binary logarithm."""

    def value(self, features: Mapping[str, Any]) -> float:
        """The value that the model uses; raises KeyError if the feature is unknown."""
        return math.log2(max(float(features[self.name]), self.floor))

    def text(self, transformed: float) -> str:
        """A value of the model as text, with its unit."""
        value = 2.0**transformed
        return (f"{value:.0f}" if value >= 10.0 else f"{value:.2g}") + (f" {self.unit}" if self.unit else "")


PREDICTORS = (
    Predictor("longest_unknown_m", "longest way through unknown floor", "m", 4.0),
    Predictor("odometry_deg_per_m", "heading error of the odometry over a metre", "deg", 0.1),
    Predictor("scan_observability", "how well a scan determines the position (0 to 1)", "", 0.02),
)


@dataclass(frozen=True, eq=False)
class Runs:
    """The runs of an experiment; arrays have one entry per run."""

    world: NDArray[np.intp]
    """Number of the world."""
    drive: NDArray[np.intp]
    """Number of the drive: runs of one drive have the same data and differ in the count."""
    particles: NDArray[np.int64]
    predictors: NDArray[np.float64]
    """(runs, predictors), as `Predictor.value` gives them."""
    holds: NDArray[np.bool_]
    error: NDArray[np.float64]
    """Error [m]; NaN if the run has none."""

    def of(self, chosen: NDArray[Any]) -> Runs:
        """Some of the runs: a mask or row numbers."""
        return Runs(**{name: values[chosen] for name, values in vars(self).items()})


@dataclass(frozen=True, eq=False)
class NeededCount:
    """The fitted model. The first row of each array of coefficients is the fit, the others are bootstrap resamples."""

    max_count: int
    """The largest count of the experiment, which the others are compared with."""
    centre: NDArray[np.float64]
    """Median of each predictor in the experiment, (predictors,)."""
    low: NDArray[np.float64]
    """Smallest value of each predictor in the experiment, (predictors,)."""
    high: NDArray[np.float64]
    """Largest value of each predictor in the experiment, (predictors,)."""
    holding: NDArray[np.float64]
    """Coefficients of the log odds of holding: constant, log2(particles), predictors less `centre`."""
    growth: NDArray[np.float64]
    """Coefficients of the slope of the log error ratio: constant, predictors less `centre`."""
    provenance: Mapping[str, Any]
    """Where the fit comes from."""

    def holds(self, particles: NDArray[Any], predictors: NDArray[np.float64], row: int = 0) -> NDArray[np.float64]:
        """Probability that a run holds, for counts (n,) or one count each and predictors (p,) or (n, p)."""
        constant, slope, *others = self.holding[row]
        odds: NDArray[np.float64] = expit(
            constant + slope * np.log2(particles) + (predictors - self.centre) @ np.array(others)
        )
        return odds

    def error_ratio(
        self, particles: NDArray[Any], predictors: NDArray[np.float64], row: int = 0
    ) -> NDArray[np.float64]:
        """Error relative to that of the largest count, at least 1; shapes as in `holds`."""
        constant, *others = self.growth[row]
        slope = np.clip(constant + (predictors - self.centre) @ np.array(others), 0.0, _MAX_SLOPE)
        ratio: NDArray[np.float64] = np.exp(slope * (particles**-0.5 - self.max_count**-0.5))
        return ratio

    def needed(self, predictors: NDArray[np.float64], row: int = 0) -> int | None:
        """The smallest count that is as good as the largest one; None if not even the largest one holds."""
        counts = np.arange(1, self.max_count + 1)
        holds = self.holds(counts, predictors, row)
        if holds[-1] < MIN_HOLDING:
            return None
        enough = (holds >= holds[-1] - MAX_LOSS) & (self.error_ratio(counts, predictors, row) <= MAX_RATIO)
        return int(counts[np.argmax(enough)])

    def interval(self, predictors: NDArray[np.float64]) -> tuple[int | None, int | None]:
        """95 % interval of `needed` over the resamples; None stands for more than the largest count."""
        found = [self.needed(predictors, row) for row in range(1, len(self.holding))]
        ordered = sorted(math.inf if count is None else count for count in found)
        ends = (ordered[round(share * (len(ordered) - 1))] for share in (0.025, 0.975))
        low, high = (None if math.isinf(end) else int(end) for end in ends)
        return low, high

    def outside(self, predictors: NDArray[np.float64]) -> list[Predictor]:
        """The predictors whose value lies outside of what the experiment covered."""
        beyond = (predictors < self.low - 0.1) | (predictors > self.high + 0.1)
        return [predictor for predictor, out in zip(PREDICTORS, beyond, strict=True) if out]

    @property
    def record(self) -> str:
        """How the expected counts did in worlds that were held out, in words; empty if that was not tested."""
        held_out = self.provenance.get("held_out")
        if held_out is None:
            return ""
        return f"the expected count was too small in {held_out['too_small']} of {held_out['worlds']} held-out worlds"

    def document(self) -> dict[str, Any]:
        """The model as plain data for JSON."""
        arrays = {name: getattr(self, name).round(5).tolist() for name in _ARRAYS}
        return {
            "provenance": dict(self.provenance),
            "predictors": [predictor.name for predictor in PREDICTORS],
            "max_count": self.max_count,
            **arrays,
        }


_ARRAYS = ("centre", "low", "high", "holding", "growth")


def shipped_model() -> NeededCount:
    """The fit that comes with the package."""
    document = json.loads((resources.files("eval") / "sweep" / DATA).read_text(encoding="utf-8"))
    if document["predictors"] != [predictor.name for predictor in PREDICTORS]:
        raise ValueError(f"{DATA}: has the predictors {document['predictors']}: run tools.measure.needed_count again")
    arrays = {name: np.array(document[name], dtype=np.float64) for name in _ARRAYS}
    return NeededCount(max_count=document["max_count"], provenance=document["provenance"], **arrays)


def predictors_of(features: Mapping[str, Any]) -> NDArray[np.float64]:
    """The predictors (p,) of a drive from its features."""
    return np.array([predictor.value(features) for predictor in PREDICTORS])


def fit(runs: Runs, provenance: Mapping[str, Any], *, resamples: int = RESAMPLES) -> NeededCount:
    """Fit the model, and again to `resamples` draws of the worlds with replacement."""
    centre = np.median(runs.predictors, axis=0)
    worlds = np.unique(runs.world)
    rng = np.random.default_rng(0)
    samples = [np.arange(len(runs.world))]
    for _ in range(resamples):
        drawn = rng.choice(worlds, len(worlds))
        samples.append(np.concatenate([np.flatnonzero(runs.world == world) for world in drawn]))
    return NeededCount(
        max_count=int(runs.particles.max()),
        centre=centre,
        low=runs.predictors.min(axis=0),
        high=runs.predictors.max(axis=0),
        holding=np.array([_fit_holding(runs.of(rows), centre) for rows in samples]),
        growth=np.array([_fit_growth(runs, rows, centre) for rows in samples]),
        provenance=provenance,
    )


def _fit_holding(runs: Runs, centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Constant and slopes of the log odds of holding."""
    x = np.column_stack([np.log2(runs.particles), runs.predictors - centre])
    return _penalised(x, lambda z, ridge: _logistic(z, runs.holds.astype(np.float64), ridge))


def _fit_growth(runs: Runs, rows: NDArray[np.intp], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Constant and slopes of the slope of the log error ratio, from runs that hold with both counts."""
    largest = int(runs.particles.max())
    of_drive = {int(runs.drive[k]): k for k in np.flatnonzero(runs.particles == largest)}
    base = np.array([of_drive.get(int(runs.drive[k]), -1) for k in rows])
    valid = (base >= 0) & (runs.particles[rows] < largest) & runs.holds[rows] & runs.holds[base]
    valid &= np.isfinite(runs.error[rows]) & np.isfinite(runs.error[base])
    k, b = rows[valid], base[valid]
    ratio = np.clip(np.log(runs.error[k] / runs.error[b]), -_MAX_LOG_RATIO, _MAX_LOG_RATIO)
    scale = runs.particles[k] ** -0.5 - largest**-0.5

    def solve(z: NDArray[np.float64], ridge: NDArray[np.float64]) -> NDArray[np.float64]:
        weighted = z * scale[:, None]
        solution: NDArray[np.float64] = np.linalg.solve(weighted.T @ weighted + ridge, weighted.T @ ratio)
        return solution

    return _penalised(runs.predictors[k] - centre, solve)


def _penalised(
    x: NDArray[np.float64], solve: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Constant and slopes in the units of x (n, p), from a solver for the standardised design with a ridge."""
    mean = x.mean(axis=0)
    scale = np.where(x.std(axis=0) > 0.0, x.std(axis=0), 1.0)
    design = np.column_stack([np.ones(len(x)), (x - mean) / scale])
    ridge = np.diag([1e-6, *np.full(x.shape[1], _RIDGE)])
    constant, *slopes = solve(design, ridge)
    own = np.array(slopes) / scale
    return np.array([constant - own @ mean, *own])


def _logistic(x: NDArray[np.float64], y: NDArray[np.float64], ridge: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients of a logistic regression by Newton's method, with a penalty."""
    beta = np.zeros(x.shape[1])
    for _ in range(50):
        p = expit(x @ beta)
        gradient = x.T @ (y - p) - ridge @ beta
        step = np.linalg.solve((x * (p * (1.0 - p))[:, None]).T @ x + ridge, gradient)
        beta = beta + np.clip(step, -2.0, 2.0)
        if np.abs(step).max() < 1e-9:
            break
    return beta
