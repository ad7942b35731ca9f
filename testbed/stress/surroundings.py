# SPDX-License-Identifier: MIT
"""Surroundings that are harder to see: walls of glass, and people who walk about.

Both are drawn into the scans of a drive, from the poses of its frames, so that no world need be known. A drive that is
changed in this way takes the same path as before: the robot does not wait for the people.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from slam import se2
from slam.scan import Scan
from slam.se2 import Pose
from testbed.frame import Frame

PANE = 1.0
"""Side of the squares of the floor whose walls are either all of glass or not at all [m]."""
PERSON_RADIUS = 0.2
"""Radius of the circle that a lidar sees of a person [m]."""
MIN_DISTANCE = 0.5
"""People keep this far from the robot [m]; one who would be nearer is not seen."""
SIGHT = 20.0
"""People farther from the robot are not drawn [m]."""
WALK_SPEED, LEG_SECONDS = 1.2, 5.0
"""Speed of people [m/s], and the time after which each takes another direction [s]."""
_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
"""Constants of splitmix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014)."""


def turn_walls_to_glass(frames: Sequence[Frame], share: float, rng: Generator) -> Iterator[Frame]:
    """Let a share of the walls be glass: beams that hit them return nothing.

    A simplification: real glass is seen where a beam meets it at a right angle, and what stands behind it is seen too.
    Raises ValueError where a scan has no true pose: the same wall must be glass at each visit.
    """
    turn, key = float(rng.uniform(0.0, 0.5 * math.pi)), np.uint64(rng.integers(1 << 63))
    for frame in frames:
        if frame.scan is None:
            yield frame
            continue
        if frame.truth is None:
            raise ValueError(f"glass: the scan at {frame.stamp:g} s has no true pose, expected a drive with its truth")
        ends = se2.transform_points(se2.compose(frame.truth, np.array(frame.scan.mount)), _ends(frame.scan))
        glass = frame.scan.hit & (_uniform_of_square(se2.transform_points((0.37, 0.59, turn), ends), key) < share)
        yield replace(frame, scan=replace(frame.scan, ranges=np.where(glass, np.inf, frame.scan.ranges)))


def add_people(frames: Sequence[Frame], per_100_square_metres: float, rng: Generator) -> Iterator[Frame]:
    """Let people walk about, so many on 100 square metres on average; walls hide them, and they walk through walls.

    They move in the frame of the truth, where it is known, and in that of the odometry elsewhere.
    """
    crowd = _Crowd(np.array([frame.stamp for frame in frames]), per_100_square_metres, rng)
    for frame in frames:
        if frame.scan is None:
            yield frame
            continue
        pose = frame.odometry if frame.truth is None else frame.truth
        people = crowd.about(float(pose[0]), float(pose[1]), frame.stamp)
        yield replace(frame, scan=replace(frame.scan, ranges=_before_people(frame.scan, pose, people)))


class _Crowd:
    """People on straight ways, who take another direction each `LEG_SECONDS`.

    They live on a square of 2 `SIGHT` that repeats itself in all directions, so that a long drive takes no more of
    them. The people of a less dense crowd are the first of these.
    """

    def __init__(self, stamps: NDArray[np.float64], density: float, rng: Generator) -> None:
        legs = 2 + int(np.ptp(stamps) / LEG_SECONDS)
        draws = rng.random((max(round(1e-2 * density * (2.0 * SIGHT) ** 2), 1), 2 + legs))
        directions = 2.0 * math.pi * draws[:, 2:]
        steps = WALK_SPEED * LEG_SECONDS * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        starts = 2.0 * SIGHT * draws[:, None, :2]
        self._corners = np.concatenate([starts, starts + np.cumsum(steps, axis=1)], axis=1)
        self._began = float(stamps.min())

    def about(self, x: float, y: float, stamp: float) -> NDArray[np.float64]:
        """Positions of the people about a place [m], (people, 2)."""
        share, leg = math.modf((stamp - self._began) / LEG_SECONDS)
        first, second = self._corners[:, int(leg)], self._corners[:, int(leg) + 1]
        place = np.array([x, y])
        away = first + share * (second - first) - place
        positions: NDArray[np.float64] = np.mod(away + SIGHT, 2.0 * SIGHT) - SIGHT + place
        return positions


def _before_people(scan: Scan, pose: Pose, people: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ranges of a scan from a pose of the robot, shorter where a person stands before the wall, (beams,)."""
    away = np.hypot(*(people - pose[:2]).T)
    near = people[(away > MIN_DISTANCE + PERSON_RADIUS) & (away < min(scan.range_max, SIGHT))]
    if not len(near):
        return scan.ranges
    local = se2.transform_points(se2.inverse(se2.compose(pose, np.array(scan.mount))), near)
    ahead = np.stack([np.cos(scan.angles), np.sin(scan.angles)])
    along = local @ ahead
    across = local[:, :1] * ahead[1] - local[:, 1:] * ahead[0]
    half = np.sqrt(np.maximum(PERSON_RADIUS**2 - across**2, 0.0))
    meets = (np.abs(across) < PERSON_RADIUS) & (along > half)
    nearest = np.where(meets, along - half, np.inf).min(axis=0)
    seen = (scan.hit | scan.no_return) & (nearest < np.minimum(scan.ranges, scan.range_max))
    return np.where(seen, nearest, scan.ranges)


def _ends(scan: Scan) -> NDArray[np.float64]:
    """End points of the beams in the lidar's frame [m], (beams, 2); at the lidar where nothing was hit."""
    ranges = np.where(scan.hit, scan.ranges, 0.0)
    return np.column_stack([ranges * np.cos(scan.angles), ranges * np.sin(scan.angles)])


def _uniform_of_square(points: NDArray[np.float64], key: np.uint64) -> NDArray[np.float64]:
    """A number from [0, 1) for the square of side `PANE` that each point (n, 2) [m] lies in, always the same, (n,)."""
    cells = np.floor(points / PANE).astype(np.int64).astype(np.uint64)
    mixed: NDArray[np.uint64] = cells[:, 0] * _MIX[1] + cells[:, 1] * _MIX[2] + key
    for shift, factor in ((30, _MIX[1]), (27, _MIX[2])):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * factor
    mixed ^= mixed >> np.uint64(31)
    return (mixed >> np.uint64(11)).astype(np.float64) * 2.0**-53
