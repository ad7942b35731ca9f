# SPDX-License-Identifier: MIT
"""Health of a particle filter from its table of steps: depletion, coalescence, and whether its covariance is honest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from slam.se2 import Pose, between, compose, wrap_angle

Columns = Mapping[str, Any]
"""Columns of `steps.parquet` (docs/run-directory.md), arrays or lists of one length; None or NaN = unknown."""
LEVEL = 0.95


def column(steps: Columns, name: str) -> NDArray[np.float64]:
    """One column as floats (n,), unknown = NaN; raises ValueError where the table does not have it."""
    if name not in steps:
        raise ValueError(f"the table of steps has no column {name!r}, only {', '.join(sorted(steps))}")
    return np.array([np.nan if value is None else value for value in np.asarray(steps[name]).tolist()], np.float64)


def updates(steps: Columns) -> NDArray[np.bool_]:
    """Rows in which the filter took the scan in, (n,)."""
    mask: NDArray[np.bool_] = column(steps, "updated") == 1.0
    return mask


@dataclass(frozen=True)
class FilterHealth:
    """How the particles fared, over the rows in which the filter took the scan in."""

    updates: int
    resamplings: int
    match_failures: int
    """Scan matches that failed, summed over particles."""
    match_failure_share: float
    """The same as a share of all scan matches, 0 to 1."""
    mean_matched_share: float | None
    """Mean share of the beams that met a wall, 0 to 1, from the second update on; None where there is none."""
    loop_closures: int
    mean_ess: float
    """Effective sample size before resampling, 1 to N (Kong, Liu, Wong, JASA 89, 1994)."""
    min_ess: float
    mean_ess_share: float
    """`mean_ess` / N, 0 to 1. Trap: high as well when all particles are equally wrong."""
    coalescences: int
    """How often all particles came to descend from one; counting starts anew after each."""
    coalescence: float | None
    """Mean updates from a fresh start to the common ancestor: older loops than that cannot be mended any more. None
    where it never happened."""


def filter_health(steps: Columns) -> FilterHealth | None:
    """Measure a table of steps; None where the filter took no scan in."""
    on = updates(steps)
    if not on.any():
        return None
    n, ess = column(steps, "particles")[on], column(steps, "ess")[on]
    failures = column(steps, "match_failures")[on]
    matched = column(steps, "matched_share")[on][1:]  # the first scan meets an empty map
    spans = coalescence_spans(column(steps, "unique_ancestors")[on], column(steps, "resampled")[on])
    return FilterHealth(
        updates=int(on.sum()),
        resamplings=int(np.nansum(column(steps, "resampled")[on])),
        match_failures=int(np.nansum(failures)),
        match_failure_share=float(np.nansum(failures) / n.sum()),
        mean_matched_share=float(np.nanmean(matched)) if np.isfinite(matched).any() else None,
        loop_closures=int(np.nansum(column(steps, "loop_closed")[on])),
        mean_ess=float(np.nanmean(ess)),
        min_ess=float(np.nanmin(ess)),
        mean_ess_share=float(np.nanmean(ess / n)),
        coalescences=len(spans),
        coalescence=float(np.mean(spans)) if len(spans) else None,
    )


def coalescence_spans(unique_ancestors: NDArray[np.float64], resampled: NDArray[np.float64]) -> NDArray[np.intp]:
    """Updates from each fresh start of the count of founders to the row where it has come down to one, (k,).

    The count starts at the first row, and anew with the first resampling after it has come down to one.
    A filter of one particle has no count to speak of and gives none.
    """
    spans, start, down = [], 0, bool(unique_ancestors[0] == 1.0)
    for row in range(1, len(unique_ancestors)):
        if down:
            if resampled[row] == 1.0:
                start, down = row - 1, False
            else:
                continue
        if unique_ancestors[row] == 1.0:
            spans.append(row - start)
            down = True
    return np.array(spans, dtype=np.intp)


@dataclass(frozen=True)
class Consistency:
    """Normalised estimation error squared (NEES) of the online pose against the particles' covariance."""

    nees_mean: float
    """3 for an honest covariance of (x, y, theta); larger: too sure of itself."""
    nees_band: tuple[float, float]
    """Where the mean of as many INDEPENDENT steps would lie with 95 % chance (chi-square)."""
    inside_share: float
    """Share of steps with the truth inside the 95 % ellipsoid; 0.95 for an honest covariance."""
    steps: int
    """Steps that were judged."""
    degenerate: int
    """Steps left out: all particles (nearly) at one pose."""


def nees(steps: Columns) -> tuple[NDArray[np.intp], NDArray[np.float64], int]:
    """NEES e^T P^-1 e of each update with truth and a covariance that can be inverted.

    Returns the rows (k,), the values (k,) and how many updates were left out as degenerate. The error is taken in
    the frame of the first pose, as the filter knows no other.
    """
    estimate = np.column_stack([column(steps, name) for name in ("x", "y", "theta")])
    error = _first_pose_error(estimate, np.column_stack([column(steps, f"true_{c}") for c in ("x", "y", "theta")]))
    xx, xy, yy, xt, yt, tt = (column(steps, f"cov_{c}") for c in ("xx", "xy", "yy", "xt", "yt", "tt"))
    covariance = np.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt], axis=-1).reshape(-1, 3, 3)
    known = updates(steps) & np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    rows = np.flatnonzero(known)
    # Below 0.1 mm and 0.006 degrees of spread there is no covariance, only particles at one pose.
    floor = np.linalg.eigvalsh(covariance[rows])[:, 0] if len(rows) else np.zeros(0)
    usable = floor > 1e-8
    rows_used = rows[usable]
    solved = np.linalg.solve(covariance[rows_used], error[rows_used][:, :, None])[:, :, 0]
    values: NDArray[np.float64] = np.sum(error[rows_used] * solved, axis=1)
    return rows_used, values, int((~usable).sum())


def consistency(steps: Columns) -> Consistency | None:
    """Judge the covariance of the online pose; None without truth or without a covariance to judge.

    Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", section 5.4.2;
    for particle filter SLAM, Bailey, Nieto, Nebot, ICRA 2006, who show that all of them get too sure in the end.
    Trap: the steps of one run hang together, so the band is far too narrow for one run: it is meant for means over
    many seeds at one step; read the share and the order of magnitude.
    """
    rows, values, degenerate = nees(steps)
    if len(rows) == 0:
        return None
    m = len(rows)
    return Consistency(
        nees_mean=float(values.mean()),
        nees_band=(
            chi_square((1.0 - LEVEL) / 2.0, 3 * m) / m,
            chi_square((1.0 + LEVEL) / 2.0, 3 * m) / m,
        ),
        inside_share=float(np.mean(values <= chi_square(LEVEL, 3))),
        steps=m,
        degenerate=degenerate,
    )


def chi_square(share: float, freedom: int) -> float:
    """Quantile of the chi-square distribution (scipy.stats has it too, but takes half a second to load)."""
    return float(2.0 * gammaincinv(0.5 * freedom, share))


def _first_pose_error(estimate: Pose, truth: Pose) -> Pose:
    """Estimate minus truth (n, 3) in the estimate's frame, after the first known truth is put onto its estimate."""
    known = np.flatnonzero(np.isfinite(truth).all(axis=1))
    if len(known) == 0:
        return np.full_like(estimate, np.nan)
    first = known[0]
    expected = compose(estimate[first], between(truth[first], truth))
    error = estimate - expected
    error[:, 2] = wrap_angle(error[:, 2])
    return error
