# SPDX-License-Identifier: MIT
"""How far end points lie from the walls that they were measured on, estimated from the data.

The mean deviation of the n end points by which one scan sees one surfel has the variance

    shared + (floor + along r^2 cos^2(a) + across r^2 sin^2(a)) / n,

with ranges r and angles of incidence a: what each reading errs by itself, along its beam and by its angle, and what all
n have in common (a wall that is not straight, a beam that is wide, an edge), which does not average out. The four
variance components are found by a regression of robust scales (median absolute deviations) of groups of such means on
these terms: iteratively reweighted nonnegative least squares, as each squared scale has a standard deviation
proportional to its expectation (Searle, Casella, McCulloch 1992, section 12.8).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from slam.refinement._noise_kernels import average_pairs

MIN_SIGMA = 0.02
"""Smallest standard deviation with which an end point counts [m]. Deviations show less: poses and surfels were fitted
to them, and what a surfel errs by, all scans from one side share. With 0.002 m near end points alone decide, and
simulated paths get worse."""
MAD_TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian divided by its median absolute deviation."""
MIN_GROUP = 30
"""Number of means from which a group has a scale: it is known to 15 % then."""
PER_OCTAVE = 1
"""Groups per doubling of the number of end points, and of each squared range."""
OCTAVES = 4096
"""More than there are doublings between the least and the largest number."""
MIN_SQUARED_RANGE = 1e-2
"""Below this squared range [m^2] all means are in one group."""
REWEIGHTINGS = 4
"""Rounds of the regression; the weights hardly change after the second."""
MIN_VARIANCE = 1e-8
"""Smallest expected variance in the regression's weights [m^2]."""


class Noise(NamedTuple):
    """Variance components of end points about a wall."""

    floor: float
    """Of each end point, at any distance [m^2]."""
    along: float
    """Of each end point along its beam, as a share of the squared range."""
    across: float
    """Of each end point across its beam, as a share of the squared range: that of the beam's angle [rad^2]."""
    shared: float
    """Of all end points of a scan on a surfel together [m^2]."""


INITIAL = Noise(floor=MIN_SIGMA**2, along=0.01**2, across=0.0, shared=0.0)
"""What the first round takes, before it has seen the data: larger than most lidars' noise, since the poses err too."""


def estimate_noise(
    first: NDArray[np.int64],
    surfel: NDArray[np.int32],
    deviation: NDArray[np.float64],
    ranges: NDArray[np.float64],
    view_directions: NDArray[np.float64],
    normal: NDArray[np.float64],
    before: Noise,
) -> Noise:
    """Variance components of end points, those of scan i from first[i] to first[i + 1].

    surfel (n,): number of the surfel of each, or -1;  deviation (n,): distance from it [m];  ranges (n,): lengths of
    the beams [m];  view_directions (n, 2): unit vectors towards where they were seen from;  normal (surfels, 2)
    before: returned where the data are too few
    """
    pairs = np.empty((len(surfel), 4))
    pairs = pairs[: average_pairs(first, surfel, deviation, ranges, view_directions, normal, pairs)]
    count, (group, size) = pairs[:, 1], _groups_of(pairs)
    enough = size >= MIN_GROUP
    if np.count_nonzero(enough) < len(Noise._fields):
        return before
    variance = _squared_scales(pairs[:, 0], group, size)[enough]
    shares = [np.bincount(group, part / count) / size for part in (1.0, pairs[:, 2], pairs[:, 3])]
    design = np.stack([np.ones(len(size)), *shares], axis=1)[enough]
    expected = np.maximum(variance, MIN_VARIANCE)
    for _ in range(REWEIGHTINGS):
        weight = np.sqrt(size[enough]) / expected
        components, _ = nnls(design * weight[:, None], variance * weight)
        expected = np.maximum(design @ components, MIN_VARIANCE)
    shared, floor, along_share, across_share = components.tolist()
    return Noise(floor, along_share, across_share, shared)


def _groups_of(pairs: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of the group of each pair (n, 4) of `average_pairs`, (n,), and the sizes of the groups, (groups,)."""
    key = np.zeros(len(pairs), np.int64)  # whole logarithms, one after the other: sorted as numbers, and little memory
    for column, least in ((1, 1.0), (2, MIN_SQUARED_RANGE), (3, MIN_SQUARED_RANGE)):
        octave = np.rint(PER_OCTAVE * np.log2(np.maximum(pairs[:, column], least))).astype(np.int64)
        key = OCTAVES * key + octave + OCTAVES // 2
    _, group, size = np.unique(key, return_inverse=True, return_counts=True)
    return group, size


def _squared_scales(
    mean: NDArray[np.float64], group: NDArray[np.int64], size: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Squared robust scales of the means (n,) in each group [m^2], (groups,); group (n,), size (groups,)."""
    order = np.lexsort((np.abs(mean), group))
    middle = np.concatenate([[0], np.cumsum(size)[:-1]]) + (size - 1) // 2
    scales: NDArray[np.float64] = (MAD_TO_SIGMA * np.abs(mean[order[middle]])) ** 2
    return scales


def for_weights(noise: Noise) -> Noise:
    """The noise with which end points count in the adjustment: at least `MIN_SIGMA` each."""
    return noise._replace(floor=max(noise.floor, MIN_SIGMA**2))
