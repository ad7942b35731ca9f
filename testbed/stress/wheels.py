# SPDX-License-Identifier: MIT
"""Odometry that is worse than it was recorded, for the whole drive."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from slam import se2
from testbed.frame import Frame
from testbed.simulation.robot.odometry import GRADES, OdometryConfig
from testbed.stress.perturbations import SLIP_SECONDS

TRACK = 0.3
"""Distance between the wheels of a robot that slips [m]."""
SLIP_DISTANCE = 0.15
"""Mean distance that a wheel spins ahead in one slip [m]."""


def add_odometry_noise(frames: Sequence[Frame], times_typical: float, rng: Generator) -> Iterator[Frame]:
    """Add errors of the wheels, so many times those that the simulator calls typical, to what they report.

    Distance and rotation get a wrong scale, drawn once, and each step a random error whose variance grows with the
    distance and the rotation (`testbed.simulation.robot.odometry`).
    """
    typical, config = GRADES["typical"], OdometryConfig()
    distance, rotation = 1.0 + times_typical * np.array(typical) * rng.standard_normal(2)
    scale = np.array([distance, distance, rotation])
    normals = rng.standard_normal((len(frames), 2))
    before, odometry = frames[0].odometry, frames[0].odometry
    for frame, (ahead, turn) in zip(frames, normals.tolist(), strict=True):
        step = se2.between(before, frame.odometry)
        length, turned = math.hypot(step[0], step[1]), abs(float(step[2]))
        along = times_typical * config.random_translation * math.sqrt(length) * ahead
        about = times_typical * config.random_rotation * math.sqrt(length + turned) * turn
        odometry = se2.compose(odometry, scale * step + np.array([along, 0.0, about]))
        before = frame.odometry
        yield replace(frame, odometry=odometry, twist=None if frame.twist is None else scale * frame.twist)


def slip_at_random(frames: Sequence[Frame], per_metre: float, rng: Generator) -> Iterator[Frame]:
    """Let one wheel spin ahead now and then, so many times a metre on average, for `SLIP_SECONDS` each time."""
    stamps = np.maximum.accumulate([frame.stamp for frame in frames])
    motion, velocity = _reported(stamps, *_slips(frames, stamps, per_metre, rng))
    before, odometry = frames[0].odometry, frames[0].odometry
    for row, frame in enumerate(frames):
        odometry = se2.compose(odometry, se2.compose(se2.between(before, frame.odometry), motion[row]))
        before = frame.odometry
        yield replace(frame, odometry=odometry, twist=None if frame.twist is None else frame.twist + velocity[row])


def _slips(
    frames: Sequence[Frame], stamps: NDArray[np.float64], per_metre: float, rng: Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) [s] and reported motions (n, 3) [m, m, rad] of the slips of a drive.

    The slips of a drive that slips more rarely are the first of these, farther apart.
    """
    steps = np.diff([frame.odometry[:2] for frame in frames], axis=0).reshape(-1, 2)
    path = np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1])))
    draws = rng.random((20 + math.ceil(2.0 * per_metre * path[-1]), 3))
    along = np.cumsum(-np.log1p(-draws[:, 0])) / per_metre
    distance = -SLIP_DISTANCE * np.log1p(-draws[:, 1])
    turn = np.where(draws[:, 2] < 0.5, -distance, distance) / TRACK
    motions = np.column_stack([0.5 * distance, np.zeros(len(draws)), turn])
    on_path = along < path[-1]
    return np.interp(along[on_path], path, stamps), motions[on_path]


def _reported(
    stamps: NDArray[np.float64], times: NDArray[np.float64], motions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What slips add to the motion from the frame before to each frame, and to the velocity at it, both (frames, 3)."""
    motion, velocity = np.zeros((2, len(stamps), 3))
    for time, slipped in zip(times.tolist(), motions, strict=True):
        first, last = np.searchsorted(stamps, (time, time + SLIP_SECONDS)).tolist()
        velocity[first:last] += slipped / SLIP_SECONDS
        rows = np.arange(max(first, 1), min(last + 1, len(stamps)))
        share = np.minimum(stamps[rows], time + SLIP_SECONDS) - np.maximum(stamps[rows - 1], time)
        motion[rows] += np.maximum(share, 0.0)[:, None] / SLIP_SECONDS * slipped
    return motion, velocity
