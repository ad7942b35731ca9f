# SPDX-License-Identifier: MIT
"""Health of a particle filter from its table of steps: matching, effective sample size, common ancestors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.filter.step_table import Columns, column, updates


@dataclass(frozen=True)
class FilterHealth:
    """Counts and means over the rows in which the filter took the scan in."""

    updates: int
    resamplings: int
    match_failures: int
    """Scan matches that failed, summed over particles."""
    match_failure_share: float
    """The same as a share of all scan matches, 0 to 1."""
    mean_matched_share: float | None
    """Mean share of the beams that met a wall, 0 to 1, from the second update on; None where there is none."""
    loop_closures: int
    largest_loop_m: float | None
    """Length of the longest loop, closed or left open: driven since its walls were last seen [m]; None = none."""
    largest_loop_stamp: float | None
    """Stamp of the scan at which it had its full length [s]."""
    mean_ess: float
    """Effective sample size before resampling, 1 to N (Kong, Liu, Wong, JASA 89, 1994)."""
    min_ess: float
    mean_ess_share: float
    """`mean_ess` / N, 0 to 1. Trap: high as well when all particles are equally wrong."""
    coalescences: int
    """How often all particles came to share one ancestor; counting starts again after each time."""
    coalescence: float | None
    """Mean number of updates until all particles share one ancestor; None where it never happened. Loops that are
    longer than that can no longer be closed by choosing another particle."""


def filter_health(steps: Columns) -> FilterHealth | None:
    """Summarise a table of steps; None where the filter took no scan in."""
    on = updates(steps)
    if not on.any():
        return None
    n, ess = column(steps, "particles")[on], column(steps, "ess")[on]
    failures = column(steps, "match_failures")[on]
    matched = column(steps, "matched_share")[on][1:]  # the first scan meets an empty map
    loop_m, loop_stamp = _largest_loop(steps)
    spans = coalescence_spans(column(steps, "unique_ancestors")[on], column(steps, "resampled")[on])
    return FilterHealth(
        updates=int(on.sum()),
        resamplings=int(np.nansum(column(steps, "resampled")[on])),
        match_failures=int(np.nansum(failures)),
        match_failure_share=float(np.nansum(failures) / n.sum()),
        mean_matched_share=float(np.nanmean(matched)) if np.isfinite(matched).any() else None,
        loop_closures=int(np.nansum(column(steps, "loop_closed")[on])),
        largest_loop_m=loop_m,
        largest_loop_stamp=loop_stamp,
        mean_ess=float(np.nanmean(ess)),
        min_ess=float(np.nanmin(ess)),
        mean_ess_share=float(np.nanmean(ess / n)),
        coalescences=len(spans),
        coalescence=float(np.mean(spans)) if len(spans) else None,
    )


def _largest_loop(steps: Columns) -> tuple[float, float] | tuple[None, None]:
    """Length [m] and stamp [s] of the longest loop; None where no old walls came into view again, or lengths are
    unknown."""
    if "loop_length" not in steps:  # tables of older releases
        return None, None
    lengths = np.nan_to_num(column(steps, "loop_length"))
    row = int(np.argmax(lengths))
    return (float(lengths[row]), float(column(steps, "stamp")[row])) if lengths[row] > 0.0 else (None, None)


def coalescence_spans(unique_ancestors: NDArray[np.float64], resampled: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the number of updates from each start of a count until all particles share one ancestor, (k,).

    A count starts at the first row, and again with the first resampling after the number of unique ancestors (n,) has
    come down to one. A filter of one particle gives no span.
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
