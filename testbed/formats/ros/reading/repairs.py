# SPDX-License-Identifier: MIT
"""Faults that recordings often have, found and mended: each function returns what to use, and notes for the user."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.motion.continuous_odometry import MAX_SPEED, MAX_TURN_RATE, has_jumped
from testbed.formats.ros.reading.content import BagContent
from testbed.formats.ros.reading.decode import RawScan, Track, seconds

Floats = NDArray[np.float64]
Stamped = TypeVar("Stamped", Track, Sequence[RawScan])

MIN_LOOP = 1.0
"""Stamps that step back by more than this [s] mean that a recording begins again."""
NEIGHBOURS, FAR = 2, 5.0
"""A stamp that is further from the median of so many on each side than so many usual periods, and than `MIN_LOOP`, is
a stray."""
MAX_SWEEP = 2.0
"""Longest time that the beams of one scan can take [s]."""
MAX_JUMP_SHARE = 0.01
"""Odometry that jumps more often, as a share of its messages, does not start again: it is left as it is."""
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


def sound_beat(beat: float, readings: int) -> bool:
    """Tell whether the time between two beams [s] can be true: all of a scan within `MAX_SWEEP`."""
    return math.isfinite(beat) and abs(beat) * max(readings - 1, 1) <= MAX_SWEEP


def strays(stamps: Floats) -> NDArray[np.bool_]:
    """Tell which stamps (n,) [s], in the order of the bag, are far from those of their neighbours on both sides."""
    if len(stamps) < 2 * NEIGHBOURS + 1:
        return np.zeros(len(stamps), dtype=bool)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(stamps, NEIGHBOURS, mode="reflect"), 2 * NEIGHBOURS + 1)
    usual = float(np.median(np.abs(np.diff(stamps))))
    found: NDArray[np.bool_] = np.abs(stamps - np.median(windows, axis=1)) > max(MIN_LOOP, FAR * usual)
    return found


def first_pass(stamps: Floats) -> int:
    """How many messages come before the recording begins again; stamps in the order of the bag [s], (n,)."""
    if not len(stamps):
        return 0
    back = np.flatnonzero(stamps < np.maximum.accumulate(stamps) - MIN_LOOP)
    return int(back[0]) if back.size else len(stamps)


def bag_time(stamps: Floats, times: Floats, offset: float) -> Floats | None:
    """The bag's own times less an offset [s], (n,), where most stamps of a topic repeat the one before and the times do
    not; else None."""
    if len(stamps) > 2 and np.mean(np.diff(stamps) == 0.0) > 0.5 > np.mean(np.diff(times) == 0.0):
        return times - offset
    return None


def _useless(stamps: Floats, whose: str) -> str:
    """Say what is wrong with stamps (n,) [s] that give way to the bag's times."""
    if np.ptp(stamps) == 0.0:
        return f"all stamps of {whose} are {stamps[0]:g} s"
    return f"most stamps of {whose} repeat the one before"


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
    fast = _is_fast(track.twists)
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
    return track._replace(twists=np.where(_is_fast(twists)[:, None], np.nan, twists)), notes


def _is_fast(twists: Floats) -> NDArray[np.bool_]:
    """Tell which twists (n, 3) are more than any robot reaches, (n,)."""
    forward, sideways, turn = np.abs(twists).T
    fast: NDArray[np.bool_] = (np.maximum(forward, sideways) > MAX_SPEED) | (turn > MAX_TURN_RATE)
    return fast


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
    """
    steps, spans = se2.between(track.poses[:-1], track.poses[1:]), np.diff(track.stamps)
    length, turn = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    jumps = np.flatnonzero(has_jumped(steps, spans)).tolist()
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


def one_clock(content: BagContent, times: NDArray[np.float64], track: Track) -> Track:
    """Odometry without repeated passes, with the bag's `times` [s], (n,), where all of its stamps are equal."""
    moving = np.append(True, (np.diff(track.poses, axis=0) != 0.0).any(axis=1))  # a pose may well be sent twice
    mended = bag_time(track.stamps, times, 0.0)
    if len(track.stamps) and np.ptp(track.stamps) > 0.0 and bag_time(track.stamps[moving], times[moving], 0.0) is None:
        mended = None
    if mended is not None:
        content.notes.append(f"{_useless(track.stamps, 'the odometry')}: the bag's own times are used")
        track = track._replace(stamps=mended)
    else:
        content.clock_offset = float(np.median(times - track.stamps))
    if (stray := strays(track.stamps)).any():
        content.notes.append(f"{stray.sum()} stamps of the odometry are far from those of their neighbours: left out")
        track = track.chosen(~stray)
    count = first_pass(track.stamps)
    if count < len(track.stamps):
        content.notes.append(
            f"time steps back by {track.stamps[:count].max() - track.stamps[count]:.1f} s: the recording was played "
            f"more than once; the first pass is used, {len(track.stamps) - count} messages of odometry are left out"
        )
    return track.first(count)


def in_one_pass(
    content: BagContent, nanoseconds: list[int], scans: list[RawScan]
) -> tuple[list[RawScan], NDArray[np.int64]]:
    """Scans of a topic without repeated passes, by the times of the bag where all of their stamps are equal; and which
    of the messages they are.

    nanoseconds: times of the bag [ns]
    """
    stamps = np.array([scan.stamp for scan in scans])
    times = np.array([seconds(time) for time in nanoseconds])
    mended = bag_time(stamps, times, content.clock_offset)
    if mended is not None:
        content.notes.append(f"{_useless(stamps, 'the scans')}: the bag's own times are used")
        stamps = mended
        scans = [scan._replace(stamp=stamp) for scan, stamp in zip(scans, stamps.tolist(), strict=True)]
    content.scan_clock_offset = float(np.median(times - stamps))
    once = ~_repeated(scans)
    if not once.all():
        content.notes.append(f"{(~once).sum()} scans are in the bag twice: one of each two is left out")
        kept_once = np.flatnonzero(once)
        scans, stamps = [scans[row] for row in kept_once.tolist()], stamps[kept_once]
    else:
        kept_once = np.arange(len(scans))
    if (stray := strays(stamps)).any():
        content.notes.append(f"{stray.sum()} stamps of scans are far from those of their neighbours: left out")
    kept = np.flatnonzero(~stray)
    count = first_pass(stamps[kept])
    if count < len(kept):
        content.notes.append(f"{len(kept) - count} scans from where their time steps back on are left out")
    kept = kept[:count]
    return [scans[row] for row in kept.tolist()], kept_once[kept]


def _repeated(scans: Sequence[RawScan]) -> NDArray[np.bool_]:
    """Tell which scans have the stamp, the frame and the readings of the one before."""
    return np.array(
        [False]
        + [
            a.stamp == b.stamp and a.frame_id == b.frame_id and np.array_equal(a.ranges, b.ranges, equal_nan=True)
            for a, b in pairwise(scans)
        ]
    )[: len(scans)]
