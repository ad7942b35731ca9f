# SPDX-License-Identifier: MIT
"""Statistics of a few runs with different seeds: intervals, paired differences, detectable effects."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri, stdtrit

LEVEL = 0.95
"""Confidence level of all intervals."""
POWER = 0.8
"""Probability with which the minimum detectable effect is found."""
RESAMPLES = 4000
"""Bootstrap resamples."""
Statistic = Callable[..., Any]
"""`np.median` or `np.mean`: takes an array and an axis."""


def min_values(level: float = LEVEL) -> int:
    """The fewest values that support a claim: even their whole range holds the median in 1 - 2^(1 - n) of cases only.

    6 for 95 %, 8 for 99 %.
    """
    return math.ceil(1.0 - math.log2(1.0 - level))


@dataclass(frozen=True)
class Interval:
    """A statistic of several runs with its confidence interval, in the unit of the values."""

    value: float
    low: float
    """NaN, as `high` and `standard_error`, for fewer than two values."""
    high: float
    standard_error: float
    count: int
    """Number of values used."""

    def contains(self, value: float) -> bool:
        """Whether a value lies in the interval (ends included)."""
        return self.low <= value <= self.high


def bootstrap_interval(values: ArrayLike, statistic: Statistic, *, level: float = LEVEL) -> Interval:
    """A statistic of values (n,) with its interval by the expanded percentile bootstrap; NaN is left out.

    Plain percentile intervals are too narrow for few values: for n = 10 they hold a mean in about 90 % of cases instead
    of 95 %. The expanded ones take the quantiles Phi(-+ sqrt(n / (n - 1)) t_{n-1}) of the resampled statistic, and the
    standard error is enlarged by the same root. Trap: five skewed values still hold their mean in 88 % only.
    The resamples are the same for every call with n values: equal values give equal intervals.
    Source: Hesterberg, "What Teachers Should Know About the Bootstrap", The American Statistician 69(4), 2015.
    """
    x = np.asarray(values, dtype=np.float64)
    x = x[np.isfinite(x)]
    n = len(x)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, math.nan, 0)
    value = float(statistic(x, axis=0))
    if n == 1:
        return Interval(value, math.nan, math.nan, math.nan, 1)
    resampled = statistic(x[_resamples(n)], axis=1)
    t = stdtrit(n - 1, 0.5 + 0.5 * level)
    tail = float(ndtr(-math.sqrt(n / (n - 1)) * t))
    low, high = np.quantile(resampled, [tail, 1.0 - tail])
    return Interval(value, float(low), float(high), float(np.std(resampled)) * math.sqrt(n / (n - 1)), n)


@lru_cache(maxsize=32)
def _resamples(n: int) -> NDArray[np.intp]:
    """Indices drawn with replacement, (RESAMPLES, n)."""
    return np.random.default_rng(n).integers(0, n, (RESAMPLES, n))


def paired_difference(values: ArrayLike, baseline: ArrayLike, *, level: float = LEVEL) -> Interval:
    """Median of the differences values - baseline (n,) between runs of equal seed, with its interval.

    Pairing removes what runs of one seed share (the drive and its noise), so few seeds show small effects. Pairs with
    a NaN are left out. Single lost runs do not move the median: the failure rate reports those.
    """
    return bootstrap_interval(np.asarray(values, np.float64) - np.asarray(baseline, np.float64), np.median, level=level)


def minimum_detectable_effect(difference: Interval, *, level: float = LEVEL, power: float = POWER) -> float:
    """Smallest true difference that this many seeds show with probability `power`, in the unit of the difference.

    (t_{n-1, 1-(1-level)/2} + t_{n-1, power}) times the standard error; NaN for fewer than two values.
    Source: Bloom, "Minimum Detectable Effects", Evaluation Review 19(5), 1995.
    """
    if difference.count < 2:
        return math.nan
    freedom = difference.count - 1
    return float((stdtrit(freedom, 0.5 + 0.5 * level) + stdtrit(freedom, power)) * difference.standard_error)


def wilson_interval(failures: int, runs: int, *, level: float = LEVEL) -> tuple[float, float]:
    """Interval of a failure rate: 0 failures in 10 runs are compatible with rates up to 0.28.

    NaN for no runs. Source: Wilson, "Probable inference, the law of succession, and statistical inference",
    JASA 22(158), 1927; recommended for few runs by Brown, Cai, DasGupta, Statistical Science 16(2), 2001. Written out,
    because `scipy.stats`, which has it too, takes half a second to load; a test compares both.
    """
    if runs == 0:
        return math.nan, math.nan
    z2 = float(ndtri(0.5 + 0.5 * level)) ** 2
    middle = (failures + 0.5 * z2) / (runs + z2)
    half = math.sqrt(z2 * (failures * (runs - failures) / runs + 0.25 * z2)) / (runs + z2)
    return max(middle - half, 0.0) if failures else 0.0, min(middle + half, 1.0) if failures < runs else 1.0
