# SPDX-License-Identifier: MIT
"""Are the map's probabilities right? Proper scores and calibration on observable cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid

CLIP = 1.0 / 512.0
"""Probabilities are clipped to [CLIP, 1 - CLIP], half a grey level of a map file: a cell that is wrong with certainty
then costs 6.2 nats, not infinity."""
BINS = 10
"""Number of bins of the calibration curve."""


@dataclass(frozen=True)
class CalibrationBin:
    """Cells whose stated probability falls into one bin."""

    stated: float
    """Their mean P(occupied)."""
    observed: float
    """Share of them that is truly occupied."""
    cells: int


@dataclass(frozen=True)
class ProbabilityScore:
    """Scores of P(occupied) against the truth; unknown cells count as 0.5."""

    log_loss: float
    """-mean(ln P(truth)) [nats], 0 (certain and right) to 6.2; 0.693 for a map that knows nothing (Good 1952)."""
    brier: float
    """mean (P - truth)^2, 0 to 1; 0.25 for a map that knows nothing (Brier 1950)."""
    auc: float | None
    """Probability that an occupied cell has a higher P than a free one, 0 to 1; 0.5 = guessed; None without both."""
    calibration_error: float
    """Expected calibration error: mean |stated - observed| weighted by cells, 0 to 1 (Naeini et al., AAAI 2015)."""
    calibration: tuple[CalibrationBin, ...]
    """The calibration curve: bins of equal width that hold cells."""
    cells: int
    """Number of cells that were scored."""


def probability_score(
    grid: OccupancyGrid, truth: OccupancyGrid, observable: NDArray[np.bool_]
) -> ProbabilityScore | None:
    """Score the map's probabilities; both maps are on the same cells (`eval.map.grids.resample`).

    Returns None where no observable cell is known in the truth.

    Trap: free cells outnumber walls ten to one, so a map without walls looks good by Brier and log loss: read the AUC
    with them. A wall displaced by a cell costs as much as one that is missing.
    """
    judged = observable & truth.known
    if not judged.any():
        return None
    stated = grid.probability[judged].astype(np.float64)
    p = np.clip(np.where(np.isnan(stated), 0.5, stated), CLIP, 1.0 - CLIP)
    occupied = truth.occupied[judged]
    curve = _calibration(p, occupied)
    return ProbabilityScore(
        log_loss=float(-np.mean(np.log(np.where(occupied, p, 1.0 - p)))),
        brier=float(np.mean((p - occupied) ** 2)),
        auc=_auc(p, occupied),
        calibration_error=sum(abs(part.stated - part.observed) * part.cells for part in curve) / len(p),
        calibration=curve,
        cells=len(p),
    )


def _auc(p: NDArray[np.float64], occupied: NDArray[np.bool_]) -> float | None:
    """Return the area under the ROC curve as the Mann-Whitney statistic (Hanley and McNeil, Radiology 143, 1982)."""
    positive = int(occupied.sum())
    negative = len(occupied) - positive
    if positive == 0 or negative == 0:
        return None
    _, value, cells = np.unique(p, return_inverse=True, return_counts=True)
    mean_rank = np.cumsum(cells) - 0.5 * (cells - 1)  # equal values share the mean of their ranks
    ranks = mean_rank[value[occupied]].sum()
    return float((ranks - positive * (positive + 1) / 2.0) / (positive * negative))


def _calibration(p: NDArray[np.float64], occupied: NDArray[np.bool_]) -> tuple[CalibrationBin, ...]:
    index = np.minimum((p * BINS).astype(np.intp), BINS - 1)
    cells = np.bincount(index, minlength=BINS)
    stated = np.bincount(index, weights=p, minlength=BINS)
    observed = np.bincount(index, weights=occupied, minlength=BINS)
    return tuple(
        CalibrationBin(float(stated[i] / cells[i]), float(observed[i] / cells[i]), int(cells[i]))
        for i in range(BINS)
        if cells[i]
    )
