# SPDX-License-Identifier: MIT
"""The severity at which half of the runs fail, found by runs whose severity is chosen one after the other.

Model: a run at the severity x fails with the probability 1 / (1 + exp(-(x - t) / s)), a logistic curve with the
threshold t and the spread s. Both are estimated by Bayes' rule on a grid, from priors that are uniform in t and in
log s. Each run is made near the threshold as it is known by then, where it tells most: at quantiles of the
posterior distribution of t, so that s is learnt as well. The interval is the central one of that distribution.
Sources: Watson and Pelli, "QUEST: A Bayesian adaptive psychometric method", Perception & Psychophysics 33(2), 1983;
Kontsevich and Tyler, "Bayesian adaptive estimation of psychometric slope and threshold", Vision Research 39, 1999 (the
grid over both parameters).

Severities are on the scale of a perturbation: 0 is harmless, 1 is hopeless. The curve belongs to the drives that runs
are made on: drives of different difficulty make s larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.95
"""Probability of the interval."""
LEVELS = 33
"""Runs are made at so many severities from 0 to 1, evenly spaced, so that systems often share their drives."""
QUANTILES = (0.5, 0.1, 0.9)
"""Quantiles of the threshold at which runs are made, in turn."""
_THRESHOLDS = np.linspace(-0.3, 1.3, 161)
_SPREADS = np.geomspace(0.02, 0.4, 12)
"""Grid of the posterior distribution. A threshold may lie beyond the severities that are tried."""


@dataclass(frozen=True)
class Threshold:
    """The severity at which half of the runs fail; below 0 or above 1 it was not reached by any severity tried."""

    value: float
    """Median of the posterior distribution."""
    low: float
    high: float
    """Ends of the central interval of `LEVEL`."""
    runs: int
    """Number of runs."""


class ThresholdSearch:
    """Chooses the severities of runs, and estimates the threshold from how they ended."""

    def __init__(self) -> None:
        self._log_posterior = np.zeros((len(_THRESHOLDS), len(_SPREADS)))
        self._runs = 0

    @classmethod
    def of(cls, severities: Sequence[float], failed: Sequence[bool]) -> ThresholdSearch:
        """Return the search after these runs."""
        search = cls()
        for severity, bad in zip(severities, failed, strict=True):
            search.add(severity, failed=bad)
        return search

    @property
    def next_severity(self) -> float:
        """The severity of the next run, one of `LEVELS` from 0 to 1."""
        wanted = self._quantile(QUANTILES[self._runs % len(QUANTILES)])
        return round(min(max(wanted, 0.0), 1.0) * (LEVELS - 1)) / (LEVELS - 1)

    def add(self, severity: float, *, failed: bool) -> None:
        """Take in how a run at a severity ended."""
        slope = (severity - _THRESHOLDS[:, None]) / _SPREADS
        self._log_posterior -= np.logaddexp(0.0, -slope if failed else slope)
        self._runs += 1

    @property
    def threshold(self) -> Threshold:
        """What the runs so far say."""
        tail = 0.5 * (1.0 - LEVEL)
        return Threshold(self._quantile(0.5), self._quantile(tail), self._quantile(1.0 - tail), self._runs)

    def _quantile(self, probability: float) -> float:
        """Quantile of the posterior distribution of the threshold."""
        density: NDArray[np.float64] = np.exp(self._log_posterior - self._log_posterior.max()).sum(axis=1)
        below = (np.cumsum(density) - 0.5 * density) / density.sum()
        return float(np.interp(probability, below, _THRESHOLDS))
