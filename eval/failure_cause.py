# SPDX-License-Identifier: MIT
"""What the data show at the moment of a failure: the fault, in words with numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eval.filter.step_table import Columns, column
from eval.outcome import LOOP_DEG, LOOP_M
from eval.trajectory.trajectory import Trajectory
from eval.wording import length
from slam.se2 import Pose, between

BEFORE_S = 3.0
"""A cause begins at most this long before the moment at which it shows [s]."""
MAX_SWEEP_S = 0.5
"""It may also begin while the scan of that moment is taken: until the next scan, if that follows within this time
[s]."""
AFTER_S = 1.5
"""For so long after the moment its effect is looked at [s]. A final pass moves poses by what was seen later: after it,
an effect may also show up to so long before its cause."""
LOOK_BACK_S = 10.0
"""A lidar that saw nothing, or scans that were lost, may have done harm for this long [s]."""
MAX_SPEED, MAX_TURN_RATE = 3.0, 6.0
"""No robot drives [m/s] or turns [rad/s] faster than this by itself."""
RECOVERED = "the estimate recovered each time"
"""What is said of wheels that had slipped before: by themselves they had not made it fail."""
MIN_SLIP_M, MIN_SLIP_DEG = 0.1, 5.0
"""Odometry is at fault from either of these on …"""
MIN_SLIP_SHARE = 0.15
"""… and from this share of the motion."""
MIN_RESTART_M = 0.5
"""A restarted odometry jumps by more than this, to a pose nearer than this to its first one [m]."""
MIN_STEP_SHARE = 0.2
"""A single step from one frame to the next belongs to a slip if it misses by at least this share of `MIN_SLIP_M` or
`MIN_SLIP_DEG`, and of the largest such step."""
BLIND_SHARE = 0.2
"""A lidar is blind if less than this part of the usual number of beams returns."""
LOOP_REACH_M, MIN_LOOP_M = 1.0, 10.0
"""A robot is back at a place within the first distance of it, after the second of driving."""
GAP_FACTOR, MIN_GAP_S = 5.0, 1.0
"""Scans were lost if the time between two of them is this many times the usual one, and at least this long [s]."""


def find_cause(
    stamp: float,
    *,
    odometry: Trajectory | None,
    reference: Trajectory | None,
    steps: Columns | None = None,
    estimate: Trajectory | None = None,
    refined: bool = False,
) -> str | None:
    """Name what went wrong at a time [s] as a sentence, or None where the data show nothing.

    odometry: the wheels' poses at the scans;  reference: the true poses at the same stamps, or the scans' own where
    the truth is unknown;  steps: the table of the run;  estimate: the poses that are judged
    refined: whether a final pass has moved them, which may show an error a little before its cause
    """
    for found in (_lost_scans(stamp, odometry), _blind_lidar(stamp, steps), _wrong_motion(stamp, odometry, reference)):
        if found is not None:
            return found
    if refined and (later := _wrong_motion(stamp, odometry, reference, after=AFTER_S)) is not None:
        return f"{later}; the final pass has spread the error over the path before"
    return (
        _failed_matching(stamp, steps)
        or _wrong_history(stamp, steps, reference, estimate)
        or _wrong_place(stamp, odometry, reference, estimate)
        or _loop_left_open(stamp, reference, estimate)
    )


def another_best(stamp: float, steps: Columns | None) -> str | None:
    """Say that the reported pose jumped at an update [s] because another particle became the best; None where it did
    not, or where the table does not know. A cause for the pose while driving only: no path of a single particle jumps
    so."""
    if steps is None or "best_moved_m" not in steps:
        return None
    stamps, moved = column(steps, "stamp"), column(steps, "best_moved_m")
    at = int(np.argmin(np.abs(stamps - stamp)))
    if not moved[at] > MIN_SLIP_M:
        return None
    return f"another particle became the best: the reported pose moved by {length(float(moved[at]))}"


def _lost_scans(stamp: float, odometry: Trajectory | None) -> str | None:
    if odometry is None or len(odometry) < 3:
        return None
    gaps, ends = np.diff(odometry.stamps), odometry.stamps[1:]
    near = (ends >= stamp - LOOK_BACK_S) & (ends - gaps <= stamp)
    if not near.any():
        return None
    longest = float(gaps[near].max())
    if longest < max(MIN_GAP_S, GAP_FACTOR * float(np.median(gaps))):
        return None
    return f"no scan came for {longest:.1f} s"


def _blind_lidar(stamp: float, steps: Columns | None) -> str | None:
    if steps is None:
        return None
    hits, stamps = column(steps, "hits"), column(steps, "stamp")
    near = (stamps >= stamp - LOOK_BACK_S) & (stamps <= stamp)
    usual = float(np.median(hits))
    if not near.any() or not hits[near].min() < BLIND_SHARE * usual:
        return None
    return f"the lidar saw next to nothing: {hits[near].min():.0f} beams returned (usual: {usual:.0f})"


def _wrong_motion(
    stamp: float, odometry: Trajectory | None, reference: Trajectory | None, after: float = 0.0
) -> str | None:
    """Odometry against the true motion, up to a time after the moment [s]: a jump of either, or wheels that slipped."""
    if odometry is None or reference is None:
        return None
    _, rows, true_rows = np.intersect1d(odometry.stamps, reference.stamps, return_indices=True)
    near = _while_it_begins(odometry.stamps[rows], stamp, after)
    wheels, true, stamps = odometry.poses[rows[near]], reference.poses[true_rows[near]], odometry.stamps[rows[near]]
    if len(stamps) < 2:
        return None
    restart = _restart(wheels, odometry.poses[0])
    if restart is not None:
        jump_of_pose = _in_words(between(wheels[restart], wheels[restart + 1]))
        return f"the odometry was restarted: its pose jumped back to its start, by {jump_of_pose}"
    jump = _jump(true, stamps)
    if jump is not None:
        moved, reported = between(true[jump], true[jump + 1]), between(wheels[jump], wheels[jump + 1])
        seconds = stamps[jump + 1] - stamps[jump]
        return (
            f"the robot was pushed or carried: within {seconds:.1f} s it moved by {_in_words(moved)}, "
            f"the wheels reported {_in_words(reported)}"
        )
    if not _slipped(true, wheels):
        return None
    begun = np.flatnonzero(near)[_where_they_differ(true, wheels)]
    end = _end_of_slip(
        reference.poses[true_rows], odometry.poses[rows], odometry.stamps[rows] <= stamp + AFTER_S, begun[-1]
    )
    off = slice(begun[0], end + 1)
    true, wheels, stamps = reference.poses[true_rows][off], odometry.poses[rows][off], odometry.stamps[rows][off]
    moved, reported = between(true[0], true[-1]), between(wheels[0], wheels[-1])
    start = odometry.stamps[0]
    bent = "; the scan of this moment was taken then, and the wheels' motion bends it" if stamps[0] == stamp else ""
    slips, known = earlier_slips(odometry, reference, stamp - BEFORE_S)
    earlier = "; they had not slipped before"
    if slips:
        earlier = f"; they slipped in {slips} before this one too, and {RECOVERED}"
    return (
        f"the wheels slipped: from {stamps[0] - start:.1f} to {stamps[-1] - start:.1f} s they reported "
        f"{_in_words(reported)}, the robot moved by {_in_words(moved)}{bent}{earlier if known else ''}"
    )


def _while_it_begins(stamps: NDArray[np.float64], stamp: float, after: float) -> NDArray[np.bool_]:
    """Which stamps (n,) lie in the time in which the cause of what shows at a moment begins, see `BEFORE_S`, or up to a
    time `after` the moment [s]."""
    later = stamps[stamps > stamp]
    sweep = float(later[0]) - stamp if len(later) and later[0] <= stamp + MAX_SWEEP_S else 0.0
    return (stamps >= stamp - BEFORE_S) & (stamps <= stamp + max(sweep, after))


def _end_of_slip(true: Pose, wheels: Pose, shown: NDArray[np.bool_], row: int) -> int:
    """The row at which a slip that goes on at a row of the poses (n, 3) ends, of those that are `shown` (n,)."""
    end = row
    while end + 1 < len(true) and shown[end + 1]:
        if _severities(true[end : end + 2], wheels[end : end + 2])[0] <= MIN_STEP_SHARE:
            break
        end += 1
    return end


def _severities(one: Pose, other: Pose) -> NDArray[np.float64]:
    """How much the steps (n - 1,) of two paths (n, 3) differ, in units of what a slip is."""
    miss = between(between(one[:-1], one[1:]), between(other[:-1], other[1:]))
    found: NDArray[np.float64] = np.maximum(
        np.hypot(miss[:, 0], miss[:, 1]) / MIN_SLIP_M, np.degrees(np.abs(miss[:, 2])) / MIN_SLIP_DEG
    )
    return found


def _where_they_differ(one: Pose, other: Pose) -> slice:
    """Rows of two paths (n, 3) from the first to the last of their steps that differ; all where none stands out."""
    severity = _severities(one, other)
    steps = np.flatnonzero(severity > max(MIN_STEP_SHARE, MIN_STEP_SHARE * float(severity.max())))
    if len(steps) == 0:
        return slice(None)
    found = slice(int(steps[0]), int(steps[-1]) + 2)
    return found if _slipped(one[found], other[found]) else slice(None)


def _slipped(true: Pose, wheels: Pose) -> bool:
    """Whether the wheels' motion from first to last pose (n, 3) differs from the true one by more than wheels do."""
    miss = between(between(true[0], true[-1]), between(wheels[0], wheels[-1]))
    turned = float(np.degrees(np.abs(between(true[:-1], true[1:])[:, 2]).sum()))
    far = float(np.hypot(miss[0], miss[1])) > max(MIN_SLIP_M, MIN_SLIP_SHARE * _path(true))
    return far or abs(float(np.degrees(miss[2]))) > max(MIN_SLIP_DEG, MIN_SLIP_SHARE * turned)


def earlier_slips(odometry: Trajectory, reference: Trajectory, until: float) -> tuple[str, bool]:
    """In how many intervals before a time [s] the wheels slipped: `14 of the 74 intervals of 3 s`, each as long as the
    window before a moment; empty where in none. The second value is whether there is any interval."""
    _, rows, true_rows = np.intersect1d(odometry.stamps, reference.stamps, return_indices=True)
    before = odometry.stamps[rows] < until
    stamps = odometry.stamps[rows[before]]
    if len(stamps) == 0:
        return "", False
    wheels, true = odometry.poses[rows[before]], reference.poses[true_rows[before]]
    numbers = ((stamps[-1] - stamps) // BEFORE_S).astype(np.intp)
    pieces = [np.flatnonzero(numbers == number) for number in np.unique(numbers)]
    slipped = sum(len(piece) > 1 and _slipped(true[piece], wheels[piece]) for piece in pieces)
    return f"{slipped} of the {len(pieces)} intervals of {BEFORE_S:.0f} s" if slipped else "", True


def _path(poses: Pose) -> float:
    """Length of the path through poses (n, 3) [m]."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def _restart(wheels: Pose, start: Pose) -> int | None:
    """The step (its first row) at which odometry poses (n, 3) jump back to the start (3,); None if there is none."""
    steps = np.hypot(*np.diff(wheels[:, :2], axis=0).T)
    home = np.hypot(wheels[1:, 0] - start[0], wheels[1:, 1] - start[1])
    jumps = np.flatnonzero((steps > MIN_RESTART_M) & (home < MIN_RESTART_M))
    return int(jumps[0]) if len(jumps) else None


def _jump(poses: Pose, stamps: NDArray[np.float64]) -> int | None:
    """The step (its first row) of poses (n, 3) that is faster than any robot, None where there is none."""
    steps, seconds = between(poses[:-1], poses[1:]), np.maximum(np.diff(stamps), 1e-3)
    fast = (np.hypot(steps[:, 0], steps[:, 1]) > np.maximum(MAX_SPEED * seconds, 0.25)) | (
        np.abs(steps[:, 2]) > np.maximum(MAX_TURN_RATE * seconds, 0.35)
    )
    return int(np.argmax(fast)) if fast.any() else None


def _failed_matching(stamp: float, steps: Columns | None) -> str | None:
    """What the filter did where the data are sound."""
    if steps is None:
        return None
    near = _shortly_before(stamp, steps)
    failed, particles = column(steps, "match_failures")[near], column(steps, "particles")[near]
    if len(failed) and failed.max() > 0:
        at = int(np.argmax(failed))
        return (
            f"scan matching failed for {failed[at]:.0f} of {particles[at]:.0f} particles; the odometry shows no fault"
        )
    return None


def _wrong_history(
    stamp: float, steps: Columns | None, reference: Trajectory | None, estimate: Trajectory | None
) -> str | None:
    """A loop that closed as the estimate made a wrong motion, or where its motion is unknown."""
    if steps is None:
        return None
    if not closes_loop(stamp, steps):
        return None
    if reference is not None and estimate is not None:
        _, true, estimated = _about(stamp, reference, estimate)
        if len(true) > 1 and not _slipped(true, estimated):
            return None
    return "the robot had come back to a known place, and the particles settled on a wrong history"


def closes_loop(stamp: float, steps: Columns) -> bool:
    """Whether old walls had come into view again shortly before an update [s]."""
    return bool((column(steps, "loop_closed")[_shortly_before(stamp, steps)] == 1.0).any())


def _shortly_before(stamp: float, steps: Columns) -> NDArray[np.bool_]:
    """The rows (scans,) of a table up to an update [s]."""
    ago = stamp - column(steps, "stamp")
    return (ago >= -1e-6) & (ago <= BEFORE_S)


def _wrong_place(
    stamp: float, odometry: Trajectory | None, reference: Trajectory | None, estimate: Trajectory | None
) -> str | None:
    """The estimate's motion about the moment where it is wrong and that of the wheels is right."""
    if odometry is None or reference is None or estimate is None:
        return None
    stamps, true, estimated = _about(stamp, reference, estimate)
    if len(stamps) < 2 or not _slipped(true, estimated):
        return None
    off = _where_they_differ(true, estimated)
    if stamps[off][0] <= stamp:
        true, estimated, stamps = true[off], estimated[off], stamps[off]
    moved, reported = between(true[0], true[-1]), between(estimated[0], estimated[-1])
    start = odometry.stamps[0]
    slips, _ = earlier_slips(odometry, reference, stamp - BEFORE_S)
    earlier = f"; in {slips} before this one they had slipped"
    return (
        f"the scans were matched to a wrong place of the map: from {stamps[0] - start:.1f} to "
        f"{stamps[-1] - start:.1f} s the estimate moved by {_in_words(reported)}, the robot by {_in_words(moved)}, as "
        f"its wheels reported{earlier if slips else ''}"
    )


def _about(stamp: float, reference: Trajectory, estimate: Trajectory) -> tuple[NDArray[np.float64], Pose, Pose]:
    """Stamps (n,) about a time [s], true and estimated poses (n, 3) then."""
    stamps, rows, own = np.intersect1d(reference.stamps, estimate.stamps, return_indices=True)
    near = (stamps >= stamp - BEFORE_S) & (stamps <= stamp + AFTER_S)
    return stamps[near], reference.poses[rows[near]], estimate.poses[own[near]]


def _loop_left_open(stamp: float, reference: Trajectory | None, estimate: Trajectory | None) -> str | None:
    """A return to a place at which the estimate is elsewhere, although no motion about the moment is wrong."""
    if reference is None or estimate is None:
        return None
    stamps, rows, own = np.intersect1d(reference.stamps, estimate.stamps, return_indices=True)
    if len(stamps) < 2:
        return None
    true, estimated, path = reference.poses[rows], estimate.poses[own], reference.distance[rows]
    now = int(np.argmin(np.abs(stamps - stamp)))
    there = np.hypot(*(true[:, :2] - true[now, :2]).T) <= LOOP_REACH_M
    before = np.flatnonzero(there & (path <= path[now] - MIN_LOOP_M))
    if len(before) == 0:
        return None
    then = int(before[np.argmin(np.hypot(*(true[before, :2] - true[now, :2]).T))])
    miss = between(between(true[then], true[now]), between(estimated[then], estimated[now]))
    if float(np.hypot(miss[0], miss[1])) <= LOOP_M and abs(float(np.degrees(miss[2]))) <= LOOP_DEG:
        return None
    return (
        f"a loop was left open: the robot is back where it was {stamps[now] - stamps[then]:.0f} s and "
        f"{path[now] - path[then]:.0f} m before, and the estimate has drifted by {_in_words(miss)} since, a little by "
        "each metre"
    )


def _in_words(motion: Pose) -> str:
    degrees = round(float(np.degrees(motion[2]))) or 0  # never -0
    return f"{length(float(np.hypot(motion[0], motion[1])))} and {degrees} degrees"
