# SPDX-License-Identifier: MIT
"""How the particle count that is needed grows with the drive: a model that is fitted to a designed experiment.

Two effects of the count are fitted, each with the features of the drive (`PREDICTORS`):

- that a run holds, that is, does not end lost or with a broken loop: logistic regression on log2(particles);
- the error of a run that holds: its logarithm is a straight line in 1 / sqrt(particles), as Monte Carlo errors are,
  whose slope depends on the features.

A count is as good as the largest one if it holds at most `MAX_LOSS` less often, and its error is at most `MAX_RATIO`
times as large.

Worlds with the same features need different counts. So both regressions have an effect of each world of its own
(`eval.sweep.mixed_model`), and what is said of another world is a distribution over worlds like it: `needed` is the
count of the middle one, `interval` and `quantile` hold for a world that is drawn from them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from eval.sweep.mixed_model import fit_odds, fit_slopes

MAX_LOSS = 0.1
"""A count may hold in this share of the runs less often than the largest one."""
MAX_RATIO = 1.1
"""Its error may be larger by this factor, the share of `eval.sweep.margin`."""
MIN_HOLDING = 0.5
"""If the largest count holds less often than this, no tested count is said to be enough."""
START = 0.9
"""The count to start with is enough in this share of the worlds like the one that is asked about."""
DRAWS = 400
"""Draws of the parameters."""
_WORLDS_PER_DRAW = 5
"""Worlds that are drawn with each draw of the parameters."""
_MAX_LOG_RATIO = math.log(10.0)
"""Logarithms of errors differ at most by so much from their mean over the counts of a drive."""
_MAX_SLOPE = 2.0 * _MAX_LOG_RATIO
"""Slopes beyond it mean no more than that many particles are needed."""
_LOGIT_SHRINKAGE = (16.0 * math.sqrt(3.0) / (15.0 * math.pi)) ** 2
"""The mean of expit(x + normal effect) is about expit(x / sqrt(1 + this times the variance)) (Zeger, Liang, Albert,
Biometrics 44(4), 1988)."""
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
    expected: int
    """1 if one expects that larger values need more particles, -1 if fewer."""

    def value(self, features: Mapping[str, Any]) -> float:
        """The value that the model uses; raises KeyError if the feature is unknown."""
        return math.log2(max(float(features[self.name]), self.floor))

    def text(self, transformed: float) -> str:
        """A value of the model as text, with its unit."""
        value = 2.0**transformed
        return (f"{value:.0f}" if value >= 10.0 else f"{value:.2g}") + (f" {self.unit}" if self.unit else "")


PREDICTORS = (
    Predictor("longest_unknown_m", "longest way through unknown floor", "m", 4.0, 1),
    Predictor("odometry_deg_per_m", "heading error of the odometry over a metre", "deg", 0.1, 1),
    Predictor("scan_observability", "how well a scan determines the position (0 to 1)", "", 0.02, -1),
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
    """The fitted model. The first row of each array of coefficients is the estimate, the others are draws from the
    approximate posterior distribution."""

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
    holding_spread: NDArray[np.float64]
    """Standard deviations of the effects of worlds and of drives on these log odds, (rows, 2)."""
    growth: NDArray[np.float64]
    """Coefficients of the slope of the log error: constant, predictors less `centre`."""
    growth_spread: NDArray[np.float64]
    """Standard deviations of the effects of worlds on that slope, and of the log errors about the line, (rows, 2)."""
    provenance: Mapping[str, Any]
    """Where the fit comes from."""

    def holds(self, particles: NDArray[Any], predictors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Probability that a run holds in a world like this, for counts (n,) or one count each.

        predictors: (p,) or (n, p)
        """
        constant, slope, *others = self.holding[0]
        odds = constant + slope * np.log2(particles) + (predictors - self.centre) @ np.array(others)
        variance = float((self.holding_spread[0] ** 2).sum())
        share: NDArray[np.float64] = expit(odds / math.sqrt(1.0 + _LOGIT_SHRINKAGE * variance))
        return share

    def needed(self, predictors: NDArray[np.float64]) -> int | None:
        """The count that the middle one of such worlds needs; None if not even the largest one holds there."""
        needed = float(self._needed(predictors, np.array([0]), np.zeros((1, 2)))[0])
        return None if math.isinf(needed) else int(needed)

    def middle_in_draws(self, predictors: NDArray[np.float64]) -> NDArray[np.float64]:
        """The count that the middle one of such worlds needs, for each draw of the parameters: how well it is known."""
        rows = np.arange(1, len(self.holding))
        return self._needed(predictors, rows, np.zeros((len(rows), 2)))

    def needed_in_worlds(self, predictors: NDArray[np.float64]) -> NDArray[np.float64]:
        """The counts that worlds like this need, one per drawn world; infinite where not even the largest one holds."""
        rows = np.repeat(np.arange(1, len(self.holding)), _WORLDS_PER_DRAW)
        return self._needed(predictors, rows, np.random.default_rng(0).standard_normal((len(rows), 2)))

    def _needed(
        self, predictors: NDArray[np.float64], rows: NDArray[np.intp], effects: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The needed count (n,) for rows of the coefficients (n,) and standardised effects (n, 2) of worlds on the log
        odds and on the slope."""
        counts = np.arange(1, self.max_count + 1)
        x = predictors - self.centre
        odds = self.holding[rows, 0] + self.holding[rows, 2:] @ x + self.holding_spread[rows, 0] * effects[:, 0]
        odds = odds[:, None] + self.holding[rows, 1][:, None] * np.log2(counts)
        holds = expit(odds / np.sqrt(1.0 + _LOGIT_SHRINKAGE * self.holding_spread[rows, 1] ** 2)[:, None])
        slope = self.growth[rows, 0] + self.growth[rows, 1:] @ x + self.growth_spread[rows, 0] * effects[:, 1]
        slope = np.clip(slope, 0.0, _MAX_SLOPE)
        growth = slope[:, None] * (counts**-0.5 - self.max_count**-0.5)
        enough = (holds >= holds[:, -1:] - MAX_LOSS) & (growth <= math.log(MAX_RATIO))
        needed: NDArray[np.float64] = counts[np.argmax(enough, axis=1)].astype(np.float64)
        needed[holds[:, -1] < MIN_HOLDING] = math.inf
        return needed

    def quantile(self, predictors: NDArray[np.float64], share: float) -> int | None:
        """The count that is enough in this share of the worlds like this; None = more than the largest count."""
        ordered = np.sort(self.needed_in_worlds(predictors))
        found = float(ordered[min(math.ceil(share * len(ordered)), len(ordered)) - 1])
        return None if math.isinf(found) else int(found)

    def interval(self, predictors: NDArray[np.float64]) -> tuple[int | None, int | None]:
        """95 % of the worlds like this need a count in this interval; None stands for more than the largest count."""
        return self.quantile(predictors, 0.025), self.quantile(predictors, 0.975)

    def start(self, predictors: NDArray[np.float64]) -> int:
        """The count to start with: enough in a share of `START` of such worlds, or the largest one that was tested."""
        return self.quantile(predictors, START) or self.max_count

    def chance(self, predictors: NDArray[np.float64], count: int) -> float:
        """Share of the worlds like this in which a count is enough."""
        return float((self.needed_in_worlds(predictors) <= count).mean())

    def outside(self, predictors: NDArray[np.float64]) -> list[Predictor]:
        """The predictors whose value lies outside of what the experiment covered."""
        beyond = (predictors < self.low - 0.1) | (predictors > self.high + 0.1)
        return [predictor for predictor, out in zip(PREDICTORS, beyond, strict=True) if out]

    def is_shown(self, predictor: Predictor) -> bool:
        """Whether the experiment shows any effect of a predictor: the 95 % interval of one of its two coefficients, on
        the odds of holding and on the slope of the error, does not hold 0."""
        k = PREDICTORS.index(predictor)
        draws = np.stack([self.holding[1:, 2 + k], self.growth[1:, 1 + k]])
        low, high = np.quantile(draws, (0.025, 0.975), axis=1)
        return bool(((low > 0.0) | (high < 0.0)).any())

    @property
    def record(self) -> str:
        """How the counts to start with did in worlds that were held out, in words; empty if that was not tested."""
        held_out = self.provenance.get("held_out")
        if held_out is None:
            return ""
        return f"it was too small in {held_out['too_small']} of {held_out['worlds']} held-out worlds"

    def document(self) -> dict[str, Any]:
        """The model as plain data for JSON."""
        arrays = {name: getattr(self, name).round(5).tolist() for name in _ARRAYS}
        return {
            "provenance": dict(self.provenance),
            "predictors": [predictor.name for predictor in PREDICTORS],
            "max_count": self.max_count,
            **arrays,
        }


_ARRAYS = ("centre", "low", "high", "holding", "holding_spread", "growth", "growth_spread")


def shipped_model() -> NeededCount:
    """The fit that comes with the package."""
    document = json.loads((resources.files("eval") / "sweep" / DATA).read_text(encoding="utf-8"))
    if document["predictors"] != [predictor.name for predictor in PREDICTORS]:
        raise ValueError(f"{DATA}: has the predictors {document['predictors']}: run tools.measure.needed_count again")
    arrays = {name: np.array(document[name], dtype=np.float64) for name in _ARRAYS}
    return NeededCount(max_count=document["max_count"], provenance=document["provenance"], **arrays)


def of_ten(share: float) -> str:
    """A share of worlds in whole tenths: `9 of 10`, `all`, `hardly any`."""
    tenths = round(10.0 * share)
    return "hardly any" if tenths == 0 else "nearly all" if tenths == 10 else f"{tenths} of 10"


def predictors_of(features: Mapping[str, Any]) -> NDArray[np.float64]:
    """The predictors (p,) of a drive from its features."""
    return np.array([predictor.value(features) for predictor in PREDICTORS])


def fit(runs: Runs, provenance: Mapping[str, Any], *, draws: int = DRAWS) -> NeededCount:
    """Fit the model."""
    centre = np.median(runs.predictors, axis=0)
    x = np.column_stack([np.ones(len(runs.world)), runs.predictors - centre])
    holding = fit_odds(
        np.insert(x, 1, np.log2(runs.particles), axis=1), runs.holds, runs.drive, runs.world, draws=draws
    )
    kept = runs.holds & np.isfinite(runs.error)
    errors = _log_errors(runs.of(kept))
    z = runs.particles[kept].astype(np.float64) ** -0.5
    growth = fit_slopes(x[kept], z, errors, runs.drive[kept], runs.world[kept], draws=draws)
    return NeededCount(
        max_count=int(runs.particles.max()),
        centre=centre,
        low=runs.predictors.min(axis=0),
        high=runs.predictors.max(axis=0),
        holding=holding.coefficients,
        holding_spread=holding.deviations,
        growth=growth.coefficients,
        growth_spread=growth.deviations,
        provenance=provenance,
    )


def _log_errors(runs: Runs) -> NDArray[np.float64]:
    """Logarithms of the errors less their mean over the drive, without outliers."""
    logs = np.log(runs.error)
    _, index = np.unique(runs.drive, return_inverse=True)
    logs -= (np.bincount(index, logs) / np.bincount(index))[index]
    return np.clip(logs, -_MAX_LOG_RATIO, _MAX_LOG_RATIO)
