# SPDX-License-Identifier: MIT
"""Errors of a log's odometry, estimated by comparison with the refined path, as settings of the simulator.

The path is cut into pieces of about a metre or a radian. Over each piece odometry states a distance and a turn, and the
path states what they were. Scales and drift are fitted to all pieces, robustly; pieces far off are slips; what is left
is random. The path has errors of its own, which do not grow with the distance: the random errors are therefore taken
from how much faster the errors of long pieces spread than those of short ones.

On real robots much of the error of the heading comes back: it grows fast over the first decimetres and slowly after
some metres. The growth over `LENGTHS` tells how fast and how slowly, and where it bends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from slam import se2
from slam.se2 import Pose
from testbed.simulation import OdometryConfig

Floats = NDArray[np.float64]

PIECE = 1.0
"""Length of a piece, where a radian counts as a metre [m]."""
MIN_PIECES = 8
"""Fewer pieces do not show how errors spread."""
GROUPS = (1, 2, 4)
"""Numbers of consecutive pieces whose errors are added up to see how they spread."""
SLIP = 4.5
"""Pieces whose turn is off by more standard deviations than this hold a slip."""
MIN_SLIP_ANGLE = math.radians(1.0)
"""Smaller errors of the turn are no slips [rad]."""
MIN_SLIPS = 3
"""Fewer of them are taken for chance."""
MIN_TURN = math.radians(0.5)
"""Half of the smallest turn between two scans that shows where the axle is [rad]."""
MAX_LEAD = 1.0
"""A point farther from the axle is no part of the robot [m]."""
LENGTHS = (0.15, 0.3, 0.6, 1.2, 2.5, 5.0, 10.0, 20.0)
"""Lengths of way, where a radian counts as a metre, over which the growth of the error of heading is measured [m]."""
RECOVERY_LENGTHS = (0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0, 5.0)
"""Lengths of recovery that are tried [m]."""
MIN_PAIRS = 20
"""Fewer pairs of poses do not show how large the errors are between them."""
MIN_GAIN = 2.0
"""A recovery is assumed where it makes the misfit so many times smaller."""
MAX_PATH_ERROR = math.radians(0.5)
"""Errors of the path's heading are smaller than this [rad]; without a bound they could not be distinguished from errors
of odometry where scans are far apart."""
MIN_BACK = 0.02
"""Shorter ways back between two scans are not taken for driving backward [m]."""
MIN_BACK_STEPS = 10
"""With fewer of them it cannot be told how the odometry counts them."""
_ROUNDS = 10
"""Rounds of the robust fit."""
_MAD = 1.4826
"""Standard deviation of a Gaussian in median absolute deviations."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pieces:
    """What odometry and path state of each piece, (n,) each."""

    distance: Floats
    """Forward displacement by the path [m]."""
    turn: Floats
    """Turn by the path [rad]."""
    odometry_distance: Floats
    """Forward displacement by odometry [m]."""
    odometry_turn: Floats
    """Turn by odometry [rad]."""
    driven: Floats
    """Distance driven by odometry [m]."""
    turned: Floats
    """Angle turned by odometry, in either direction [rad]."""
    bounds: NDArray[np.intp]
    """Poses at which the pieces begin, and the end of the last, (n + 1,)."""


def estimate_odometry(odometry: Pose, path: Pose, *, track: float) -> tuple[OdometryConfig, int]:
    """Estimate the errors of an odometry `T_odom_robot` (n, 3) from the path `T_map_robot` (n, 3) of the same times.

    track: distance of the wheels of the robot that is to have these errors [m], which decides how far a slip turns it

    Returns the settings and the number of pieces that were compared. Fewer than `MIN_PIECES` give an odometry without
    errors.
    """
    unsigned = _is_unsigned(odometry, path)
    if unsigned:
        path = _all_forward(path)
    pieces = _cut(odometry, path)
    count = len(pieces.distance)
    if count < MIN_PIECES:
        return OdometryConfig(systematic=False, random=False, ticks=False), count
    (distance_scale,), step_error = _robust_fit(pieces.distance[:, None], pieces.odometry_distance)
    (rotation_scale, drift), turn_error = _robust_fit(
        np.stack([pieces.turn, pieces.distance], axis=1), pieces.odometry_turn
    )
    slips, slip_rate, slip_angle = _slips(turn_error, float(pieces.driven.sum()))
    heading = _growth(odometry, path, (rotation_scale, drift), np.flatnonzero(slips), pieces.bounds)
    config = OdometryConfig(
        systematic=False,
        ticks=False,
        random_translation=_random(step_error, pieces.driven, slips),
        random_rotation=heading.short,
        recovered_share=heading.recovered_share,
        recovery_length=heading.length,
        unsigned=unsigned,
        slip_rate=slip_rate,
        slip_distance=slip_angle * track,
        distance_scale=float(np.clip(distance_scale, 0.5, 2.0)),
        rotation_scale=float(np.clip(rotation_scale, 0.5, 2.0)),
        drift=float(np.clip(drift, -1.0, 1.0)),
    )
    return config, count


def find_lead(poses: Pose) -> float:
    """Return how far ahead of its axle the point of a robot lies that moves along poses (n, 3) [m].

    The axle does not move sideways: on an arc it moves along the mean of both headings. A point ahead of it moves
    sideways by its lead times the turn. 0 where the turns do not show a lead.
    """
    steps = se2.between(poses[:-1], poses[1:])
    half = 0.5 * steps[:, 2]
    turns = np.abs(half) > MIN_TURN
    if turns.sum() < MIN_PIECES:
        return 0.0
    swing = 2.0 * np.sin(half[turns])
    sideways = np.cos(half[turns]) * steps[turns, 1] - np.sin(half[turns]) * steps[turns, 0]
    (lead,), errors = _robust_fit(swing[:, None], sideways)
    uncertainty = _spread(errors) / float(np.sqrt(np.sum(swing**2)))
    return lead if 3.0 * uncertainty < abs(lead) < MAX_LEAD else 0.0


def _is_unsigned(odometry: Pose, path: Pose) -> bool:
    """Tell whether odometry (n, 3) counts the way of backward driving as forward."""
    back = se2.between(path[:-1], path[1:])[:, 0] < -MIN_BACK
    counted = se2.between(odometry[:-1], odometry[1:])[back, 0]
    return len(counted) >= MIN_BACK_STEPS and bool(np.mean(counted > 0.0) > 0.9)


def _all_forward(path: Pose) -> Pose:
    """Return the path (n, 3) as it would be if each step back had been one forward, headings unwrapped."""
    steps = se2.between(path[:-1], path[1:])
    steps[steps[:, 0] < -MIN_BACK, 0] *= -1.0
    heading = path[0, 2] + np.append(0.0, np.cumsum(steps[:, 2]))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = np.append(0.0, np.cumsum(cos * steps[:, 0] - sin * steps[:, 1]))
    y = np.append(0.0, np.cumsum(sin * steps[:, 0] + cos * steps[:, 1]))
    return np.stack([path[0, 0] + x, path[0, 1] + y, heading], axis=1)


@dataclass(frozen=True, kw_only=True)
class _Growth:
    """How the random error of heading grows with the way."""

    short: float
    """At first [rad/sqrt(m)]."""
    recovered_share: float
    """Share of it that is made good on the way."""
    length: float
    """Way on which all but 1/e of that is made good [m]."""


def _growth(
    odometry: Pose, path: Pose, factors: tuple[float, float], slips: NDArray[np.intp], bounds: NDArray[np.intp]
) -> _Growth:
    """Fit the variance of the error of heading over a way s by q^2 s + p (1 - exp(-s / length)) + c.

    factors: rotation scale and drift; slips: numbers of the pieces with a slip, bounds: poses at which pieces begin.
    The constant c is due to the path. If each random turn is made good but for a share 1 - r, the growth is a^2 at
    first, q = (1 - r) a, and p = (a^2 - q^2) length.
    """
    steps, true_steps = se2.between(odometry[:-1], odometry[1:]), se2.between(path[:-1], path[1:])
    way = np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + np.abs(steps[:, 2])))
    error = np.append(0.0, np.cumsum(steps[:, 2] - factors[0] * true_steps[:, 2] - factors[1] * true_steps[:, 0]))
    lengths, variances = [], []
    for length in LENGTHS:
        end = np.searchsorted(way, way + length)
        begin = np.flatnonzero(end < len(way))
        end = end[begin]
        with_slip = np.searchsorted(bounds[slips], end) > np.searchsorted(bounds[slips + 1], begin, side="right")
        same = (way[end] - way[begin] < 1.5 * length) & ~with_slip
        if same.sum() >= MIN_PAIRS:
            lengths.append(float(np.mean(way[end[same]] - way[begin[same]])))
            variances.append(_variance(error[end[same]] - error[begin[same]]))
    s, v = np.array(lengths), np.array(variances)
    if len(s) < 2 or not v.all():
        return _Growth(short=math.sqrt(float(np.mean(v / s))) if len(s) else 0.0, recovered_share=0.0, length=1.0)
    ends = 2.0 * MAX_PATH_ERROR**2
    plain = lsq_linear(np.stack([s, np.ones_like(s)], axis=1) / v[:, None], np.ones_like(v), ([0, 0], [np.inf, ends]))
    best, found = plain.cost / MIN_GAIN, _Growth(short=math.sqrt(plain.x[0]), recovered_share=0.0, length=1.0)
    for length in RECOVERY_LENGTHS:
        columns = np.stack([s, 1.0 - np.exp(-s / length), np.ones_like(s)], axis=1)
        fit = lsq_linear(columns / v[:, None], np.ones_like(v), ([0, 0, 0], [np.inf, np.inf, ends]))
        if fit.cost < best:
            best, (slow, plateau, _) = fit.cost, fit.x.tolist()
            short = math.sqrt(slow + plateau / length)
            found = _Growth(short=short, recovered_share=1.0 - math.sqrt(slow) / short, length=length)
    return found


def _variance(errors: Floats) -> float:
    """Return the variance of errors (n,) around their mean; those beyond three standard deviations count as three."""
    limit = 3.0 * _spread(errors)
    return float(np.mean(np.clip(errors - np.median(errors), -limit, limit) ** 2))


def _cut(odometry: Pose, path: Pose) -> _Pieces:
    """Cut a drive into pieces of `PIECE`; the motion is measured by odometry, which is quiet while the robot stands."""
    steps, true_steps = se2.between(odometry[:-1], odometry[1:]), se2.between(path[:-1], path[1:])
    driven = np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1])))
    turned = np.append(0.0, np.cumsum(np.abs(steps[:, 2])))
    heading, true_heading = (np.append(0.0, np.cumsum(part[:, 2])) for part in (steps, true_steps))
    number = np.floor((driven + turned) / PIECE)
    cuts = np.flatnonzero(np.diff(number, prepend=-1.0) > 0.0)
    begin, end = cuts[:-1], cuts[1:]
    return _Pieces(
        distance=se2.between(path[begin], path[end])[:, 0],
        turn=np.diff(true_heading[cuts]),
        odometry_distance=se2.between(odometry[begin], odometry[end])[:, 0],
        odometry_turn=np.diff(heading[cuts]),
        driven=np.diff(driven[cuts]),
        turned=np.diff(turned[cuts]),
        bounds=cuts,
    )


def _robust_fit(inputs: Floats, outputs: Floats) -> tuple[list[float], Floats]:
    """Fit outputs (n,) by inputs (n, k) linearly; returns the factors, k numbers, and the residuals (n,).

    Huber's weights, found by repeated least squares, keep slips from moving the result.
    """
    weights = np.ones(len(outputs))
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)
        factors = np.linalg.lstsq(root[:, None] * inputs, root * outputs)[0]
        errors = outputs - inputs @ factors
        limit = 1.5 * max(_spread(errors), 1e-9)
        weights = limit / np.maximum(np.abs(errors), limit)
    found: list[float] = factors.tolist()
    return found, errors


def _spread(errors: Floats) -> float:
    """Return the standard deviation of errors (n,), whatever a few far ones are."""
    return _MAD * float(np.median(np.abs(errors - np.median(errors))))


def _slips(errors: Floats, driven: float) -> tuple[NDArray[np.bool_], float, float]:
    """Tell which turn errors (n,) [rad] are slips, (n,), and return their rate [1/m] and mean angle [rad].

    The angles are exponential, so that their mean is that of what exceeds the threshold, and the share of those below
    it follows. Errors just above the threshold are the tail of the random ones.
    """
    spread = _spread(errors)
    threshold = max(SLIP * spread, MIN_SLIP_ANGLE)
    around = np.convolve(errors, np.ones(3), mode="same")  # an error that the next piece makes good is no slip
    slips = (np.abs(errors) > threshold) & (np.abs(around) > threshold) & (around * errors > 0.0)
    mean = float(np.mean(np.abs(errors[slips]) - threshold)) if slips.any() else 0.0
    if slips.sum() < MIN_SLIPS or mean < spread or driven == 0.0:
        return np.zeros_like(slips), 0.0, 0.0
    return slips, float(slips.sum()) * math.exp(min(threshold / mean, 1.0)) / driven, mean


def _random(errors: Floats, lengths: Floats, slips: NDArray[np.bool_]) -> float:
    """Return the random error per root of the length, from the errors (n,) and lengths (n,) of consecutive pieces.

    The variance of k pieces is that of the path's ends and k times that of a piece; its slope over the length is asked
    for.
    """
    variances, means = [], []
    for k in GROUPS:
        sums, sizes, bad = (_sums(values, k) for values in (errors, lengths, slips.astype(np.float64)))
        good = bad == 0.0
        if good.sum() >= MIN_PIECES:
            variances.append(_variance(sums[good]))
            means.append(float(np.mean(sizes[good])))
    if len(means) < 2 or np.ptp(means) == 0.0:
        return float(np.sqrt(np.var(errors) / max(float(np.mean(lengths)), 1e-9)))
    slope = np.polyfit(means, variances, 1)[0]
    return float(np.sqrt(max(slope, 0.0)))


def _sums(values: Floats, k: int) -> Floats:
    """Return the sums of each k consecutive values, (n - k + 1,)."""
    total = np.append(0.0, np.cumsum(values))
    sums: Floats = total[k:] - total[:-k]
    return sums
