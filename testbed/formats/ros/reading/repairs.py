# SPDX-License-Identifier: MIT
"""Angles and odometry of a bag that cannot be true, found and mended: each function returns what to use, and notes for
the user."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.motion.continuous_odometry import has_jumped
from slam.sensor.possible_motion import are_impossible
from testbed.formats.ros.reading.decode import Track

Floats = NDArray[np.float64]

MAX_SWEEP = 2.0
"""Longest time that the beams of one scan can take [s]."""
MAX_JUMP_SHARE, NO_PATH_SHARE = 0.01, 0.5
"""Odometry that jumps more often, as a share of its messages, does not start again: it is left as it is; odometry that
jumps with so many of them is no path."""
MIN_JUMPS = 50
"""Of fewer jumps nothing is said."""
PIECE_SECONDS, MIN_PIECE, MIN_PIECES = 1.0, 0.1, 5
"""Twists are compared with poses over pieces of so many seconds: those in which the robot moves by so much [m], [rad],
of which there must be so many."""
MAX_TWIST_RATIO = 2.0
"""Twists that make more than so many times the motion of the poses, or less than its inverse, are none."""
MAX_FAST_SHARE = 0.1
"""Where a larger share of the twists is faster than any robot, the others are no better."""
MAX_DEGREES = 362.0
"""Largest view of a scan whose angles are in degrees."""
NOTED_BEAMS, ACCEPTED_BEAMS, ACCEPTED_SHARE = 0.5, 1.5, 0.05
"""Differences between angle_max and angle_min + increment * (n - 1): beams that are worth a note, and beams or share of
the view up to which the increment is believed."""


class Fan(NamedTuple):
    """The stated angles of a scan."""

    angle_min: float
    angle_max: float
    increment: float
    readings: int

    @property
    def difference(self) -> float:
        """How far the last beam is from angle_max [beams]; infinite where the increment is zero."""
        miss = abs(abs(self.increment) * (self.readings - 1) - abs(self.angle_max - self.angle_min))
        return miss / abs(self.increment) if self.increment else math.inf

    @property
    def is_in_degrees(self) -> bool:
        """Whether all three angles agree with each other, but only as degrees."""
        span = abs(self.angle_max - self.angle_min)
        return (
            2.0 * math.pi + 1.0 < span <= MAX_DEGREES
            and (self.angle_max - self.angle_min) * self.increment > 0.0
            and self.difference <= ACCEPTED_BEAMS
        )

    def in_radians(self) -> Fan:
        """The same of angles in degrees."""
        first, last, step = (math.radians(angle) for angle in (self.angle_min, self.angle_max, self.increment))
        return Fan(first, last, step, self.readings)

    def check(self) -> str | None:
        """A note where the numbers differ by about a beam; ValueError, with the numbers, where they contradict."""
        if self.readings < 2:
            return None
        too_far = abs(self.increment) * (self.readings - 2) > 2.0 * math.pi + 1e-3
        if not math.isfinite(self.angle_max):
            if too_far or self.increment == 0.0:
                raise ValueError(
                    f"the angles make no sense: angle_max {self.angle_max:g}, angle_increment {self.increment:.6g} rad "
                    f"and {self.readings} readings"
                )
            return f"angle_max is {self.angle_max:g}: angle_min and the increment are used"
        span = abs(self.angle_max - self.angle_min)
        backward = (self.angle_max - self.angle_min) * self.increment < 0.0 and span > 2.0 * abs(self.increment)
        accepted = max(ACCEPTED_BEAMS, ACCEPTED_SHARE * (self.readings - 1))
        if backward or self.difference > accepted or too_far:
            raise ValueError(
                f"the angles contradict each other: angle_min {self.angle_min:.6g}, angle_max {self.angle_max:.6g} and "
                f"{self.readings} readings make an increment of "
                f"{(self.angle_max - self.angle_min) / (self.readings - 1):.6g}, angle_increment is "
                f"{self.increment:.6g} rad"
            )
        if self.difference > NOTED_BEAMS:
            return (
                f"angle_max is {self.difference:.1f} beams off angle_min + {self.readings - 1} * angle_increment; the "
                "increment is used"
            )
        return None


def sound_beats(beats: Floats, readings: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which times between two beams [s] can be true, (n,): all of a scan within `MAX_SWEEP`."""
    with np.errstate(invalid="ignore", over="ignore"):
        sound: NDArray[np.bool_] = np.abs(beats) * np.maximum(readings - 1, 1) <= MAX_SWEEP
    return sound


def with_twists(track: Track) -> Track:
    """Odometry, sorted by time, with the mean velocity up to the next pose, for sources that hold poses only."""
    track = track.in_time()
    if len(track.stamps) < 2:
        return track
    steps = se2.between(track.poses[:-1], track.poses[1:]) / np.diff(track.stamps)[:, None]
    return track._replace(twists=np.concatenate([steps, steps[-1:]]))


def with_sound_twists(track: Track) -> tuple[Track, list[str]]:
    """Odometry, sorted by time, whose poses give the velocities where its twists contradict them or no robot reaches
    them.

    A driver that leaves twists zero, or counts degrees, would bend every scan whose beams are moved together by them.
    """
    notes, by_poses = [], with_twists(track).twists
    fast = are_impossible(track.twists)
    if fast.any():
        notes.append(f"{fast.sum()} twists of the odometry are faster than any robot: the poses give the velocities")
    twists = np.where(fast[:, None], by_poses, track.twists) if fast.mean() < MAX_FAST_SHARE else track.twists
    for axis, unit in ((0, "m"), (2, "rad")):
        ratio = _twist_ratio(track._replace(twists=twists), axis)
        if ratio is not None and not 1.0 / MAX_TWIST_RATIO < ratio < MAX_TWIST_RATIO:
            notes.append(
                f"the twists of the odometry make {ratio:.2f} {unit} of each {unit} that its poses show: the poses "
                "give the velocities"
            )
            twists = by_poses
            break
    return track._replace(twists=np.where(are_impossible(twists)[:, None], np.nan, twists)), notes


def _twist_ratio(track: Track, axis: int) -> float | None:
    """How far the twists move the robot along an axis for what the poses say: the median over the pieces in which it
    moves; None where there are few, or no twists."""
    stamps, rates = track.stamps, track.twists[:, axis]
    if len(stamps) < 2 or not np.isfinite(rates).all():
        return None
    steps = se2.between(track.poses[:-1], track.poses[1:])[:, axis]
    by_twist = 0.5 * (rates[:-1] + rates[1:]) * np.diff(stamps)
    piece = np.floor((stamps[:-1] - stamps[0]) / PIECE_SECONDS)
    first = np.flatnonzero(np.diff(piece, prepend=-1.0) > 0.0)
    moved, told = np.add.reduceat(steps, first), np.add.reduceat(by_twist, first)
    enough = np.abs(moved) > MIN_PIECE
    return float(np.median(told[enough] / moved[enough])) if enough.sum() >= MIN_PIECES else None


def bridged(track: Track) -> tuple[Track, list[str]]:
    """Odometry, sorted by time, whose jumps are taken out: what follows one is moved to where the robot was before.

    Between the messages before and after a jump the robot is taken to have moved as its twist says, if it is known.
    Raises ValueError where most messages are jumps.
    """
    steps, spans = se2.between(track.poses[:-1], track.poses[1:]), np.diff(track.stamps)
    length, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    jumps = np.flatnonzero(has_jumped(steps, spans)).tolist()
    if len(jumps) > max(NO_PATH_SHARE * len(track.stamps), MIN_JUMPS):
        raise ValueError(
            f"the odometry jumps at {len(jumps)} of {len(track.stamps)} messages, such as by {length[jumps[0]]:.2f} m "
            f"and {math.degrees(turn[jumps[0]]):.0f} deg within {spans[jumps[0]]:.2f} s: do two programs send it? "
            "expected one path"
        )
    if len(jumps) > MAX_JUMP_SHARE * len(track.stamps):
        return track, [f"the odometry jumps {len(jumps)} times, too often for a restart: it is used as it is"]
    poses, notes = track.poses.copy(), []
    for row in jumps:
        twist = track.twists[row]
        moved = twist * spans[row] if np.isfinite(twist).all() else np.zeros(3)
        T = se2.compose(se2.compose(poses[row], moved), se2.inverse(poses[row + 1]))
        poses[row + 1 :] = se2.compose(T, poses[row + 1 :])
    if jumps:
        first = jumps[0]
        more = f", and {len(jumps) - 1} times more" if jumps[1:] else ""
        notes.append(
            f"the odometry jumps by {length[first]:.2f} m and {math.degrees(turn[first]):.0f} deg within "
            f"{spans[first]:.2f} s at {track.stamps[first]:.2f} s{more}, as where it starts again: the path is joined"
        )
    return track._replace(poses=poses), notes
