# SPDX-License-Identifier: MIT
"""Find where a run went wrong: the first scan at which the estimate left the truth, or the scan left the map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.filter.step_table import Columns, column, updates
from eval.outcome import LOOP_DEG, LOOP_M, LOOP_SHARE, loop_pairs
from eval.trajectory.association import Association, AssociationError, associate
from eval.trajectory.errors import pair_errors, stretches
from eval.trajectory.relations import Relations, relation_error
from eval.trajectory.trajectory import Trajectory
from eval.wording import length, up_to_a_tenth
from slam.se2 import Pose, between, compose, inverse

Rows = NDArray[np.intp]
Numbers = Any
"""A number or an array (n,)."""

BAD_M, BAD_DEG = 0.15, 5.0
"""A metre of path is bad if the estimate's motion over it is wrong by more than either."""
HEAL_M, HEAL_DEG = 0.25, 6.0
"""The estimate has come back if it is wrong by less than both, aligned to the truth over the path before the moment or
over the first of the path: the part of the map before the moment may be the one that is warped …"""
HEAL_DRIFT_M, HEAL_DRIFT_DEG, HEAL_DRIFT_PATH = 0.01, 0.2, 10.0
"""… plus these for each metre of path since, up to so many metres: an estimate that drifts has not failed."""
HEAL_PATH = 3.0
"""… over this much of the path, or what is left of it [m]. Alignments are means over as much path."""
MIN_HEAL_PATH = 1.0
"""Less path is enough if the next excursion begins after it, but no less than this [m]."""
SHOWN_S = 3.0
"""The scan that shows a failure was taken within this time after its moment [s], at which the error is still small …"""
CLEAR_SEVERITY = 2.0
"""… unless it is already this large at the moment, in units of what makes a metre bad."""
BAD_MATCHED_SHARE = 0.5
"""Without truth: a scan is bad if less than this part of the run's usual share of beams met the map's walls …"""
BAD_FAILURE_SHARE = 0.5
"""… or scan matching failed for more than this share of the particles."""


@dataclass(frozen=True)
class Blip:
    """A stretch at which the estimate left the truth and came back."""

    stamp: float
    """When it began [s]."""
    end: float
    """When it was over [s]."""
    metres: float
    degrees: float
    """The worst error of the motion over a metre of path in it."""

    @property
    def severity(self) -> float:
        """The larger of its errors in units of what makes a metre bad."""
        return max(self.metres / BAD_M, self.degrees / BAD_DEG)


@dataclass(frozen=True, eq=False)
class Failure:
    """The moment from which the estimate does not come back, or the worst one where there is none."""

    scan: int
    since: int
    """Scan from which on the motion is wrong; `scan` itself where that is unknown."""
    stamp: float
    """[s]"""
    bad: bool
    reason: str
    """A sentence with the numbers."""
    shown_scan: int
    """The scan that shows the error best, up to `SHOWN_S` after the moment; `scan` itself where that is unknown."""
    estimated: Pose
    """Estimated pose at that scan, (3,): in the frame of the truth, aligned with it at `since`; without truth in the
    map's frame."""
    true_pose: Pose | None
    """True pose in the same frame, (3,); None if it is unknown."""
    blips: tuple[Blip, ...] = ()
    """Where the estimate left the truth before and came back."""
    cause: str | None = None
    """What the data show at the moment, as a sentence (`eval.failure_cause`); None = nothing."""
    back: float | None = None
    """When the estimate is back, where what it saw meanwhile lies at a wrong place [s]; None = it is not."""

    def time_to_watch(self, stamps: NDArray[np.float64]) -> float | None:
        """Time since the first scan at which a viewer shows the failure [s]; None where its scan is not among them.

        stamps (n,) of all scans [s].
        """
        if self.shown_scan >= len(stamps):
            return None
        return up_to_a_tenth(float(stamps[self.shown_scan] - stamps[0]))


def find_failure(
    estimate: Trajectory,
    *,
    truth: Trajectory | None = None,
    relations: Relations | None = None,
    dense: Trajectory | None = None,
    steps: Columns | None = None,
) -> Failure | None:
    """Find the first failure by the truth, else by relations (scored on `dense`), else by how the scans fitted the map.

    estimate: a pose per scan. By the truth it is judged at the updates of the filter, where `steps` names them: the
    poses between two updates are interpolated, and nobody has estimated them. Relations are used only if they show a
    failure: the worst of good ones does not mark a place. Returns None if there is nothing to judge by.
    """
    if truth is not None:
        estimated = None if steps is None else updates(steps)
        return first_bad_stretch(estimate, truth, estimated)
    found = None if relations is None else first_bad_relation(estimate, dense or estimate, relations)
    if found is None and steps is not None:
        found = first_bad_match(estimate, steps)
    return found


def first_bad_stretch(
    estimate: Trajectory, truth: Trajectory, estimated: NDArray[np.bool_] | None = None
) -> Failure | None:
    """Find the first moment from which the estimate does not come back to the truth.

    estimated (n,): which poses are the filter's own, and not interpolated between two of them; None = all.

    A metre of path is bad if the estimate's motion over it is wrong by more than `BAD_M` or `BAD_DEG`. Bad metres that
    touch are one excursion; after it the estimate has come back if it fits the truth again as it did before it, or as
    it did at the start of the run. Where all excursions heal, it is the first revisit that shows an open loop, else the
    worst metre, which is not bad. None for paths shorter than a metre, or without a common time.
    """
    try:
        everything = associate(estimate, truth)
    except AssociationError:
        return None
    matched = _at_updates(everything, estimated)
    first, last = stretches(matched, 1.0)
    if len(first) == 0:
        return None
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, (first, last))
    severity = np.maximum(translation / BAD_M, rotation / BAD_DEG)
    blips: list[Blip] = []
    excursions: list[tuple[int, int, int]] = []  # rows at which those that healed began, were bad, and were over
    back = -1
    groups = _excursions(first, last, severity > 1.0)
    begins: list[int | None] = [int(first[pieces].min()) for pieces in groups]
    passing = [_passes(matched, int(first[pieces[0]]), int(last[pieces].max())) for pieces in groups]
    for number, (group, next_begin) in enumerate(zip(groups, [*begins[1:], None][: len(groups)], strict=True)):
        on_the_way_back = first[group] < back
        if on_the_way_back.any():
            blips[-1] = _with_worst(blips[-1], translation, rotation, group[on_the_way_back])
        pieces = group[~on_the_way_back]
        if len(pieces) == 0:
            continue
        begin, end = int(first[pieces[0]]), int(last[pieces].max())
        worst = (float(translation[pieces].max()), float(rotation[pieces].max()))
        returned = _back_at(matched, begin, end, next_begin)
        begin, moment = _departure(matched, begin, int(last[pieces[0]]))
        if returned is None and passing[number] and not all(passing[number + 1 :]):
            returned = end  # the map drifts on after it; the estimate is lost later
        if returned is None:
            begin, moment = _last_departure(matched, first[pieces], last[pieces], (begin, moment))
            reason = f"the estimate leaves the truth and does not come back; {_soon_after(matched, begin, moment)}"
            return _failure(matched, begin, moment, reason, bad=True, blips=blips)
        back, stamps = returned, matched.estimate.stamps
        excursions.append((begin, moment, back))
        blips.append(Blip(float(stamps[moment]), float(stamps[back]), *worst))
    loop = _open_loop(everything)
    if loop is not None:
        visits = np.searchsorted(matched.rows, everything.rows[list(loop)])
        before, now = np.minimum(visits, len(matched.rows) - 1).tolist()
        return _failure_of_loop(matched, before, now, excursions, blips)
    worst_piece = int(np.argmax(severity))
    begin, moment = _outlier(matched, int(first[worst_piece]), int(last[worst_piece]))
    rows = np.array([begin]), np.array([moment])
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, rows)
    amount = _amount(translation[0], rotation[0])
    between_updates = "" if estimated is None else ", measured between two updates of the filter,"
    reason = f"no lasting error; over the worst metre of path{between_updates} the estimate is wrong by {amount}"
    return _failure(matched, begin, moment, reason, bad=False, blips=blips)


def _outlier(matched: Association, begin: int, end: int) -> tuple[int, int]:
    """Of two rows whose motion is wrong, the one whose pose fits its neighbours, and the one that does not."""
    path, true, estimated = matched.reference.distance, matched.reference.poses, matched.estimate.poses
    near = np.flatnonzero((path >= path[begin] - HEAL_PATH) & (path <= path[end] + HEAL_PATH))
    alignments = compose(true[near], inverse(estimated[near]))
    turned = alignments[len(near) // 2, 2]
    turns = turned + np.angle(np.exp(1j * (alignments[:, 2] - turned)))
    middle = np.array([*np.median(alignments[:, :2], axis=0), np.median(turns)])
    miss = between(true[[begin, end]], compose(middle, estimated[[begin, end]]))
    off = np.maximum(np.hypot(miss[:, 0], miss[:, 1]) / BAD_M, np.degrees(np.abs(miss[:, 2])) / BAD_DEG)
    return (begin, end) if off[1] >= off[0] else (end, begin)


def _at_updates(matched: Association, estimated: NDArray[np.bool_] | None) -> Association:
    """The pairs whose pose was estimated, see `first_bad_stretch`; all pairs where that is known of fewer than two."""
    if estimated is None or len(estimated) != matched.total:
        return matched
    kept = np.flatnonzero(estimated[matched.rows])
    if len(kept) < 2:
        return matched
    return replace(matched, estimate=matched.estimate[kept], reference=matched.reference[kept], rows=matched.rows[kept])


def _excursions(first: Rows, last: Rows, bad: NDArray[np.bool_]) -> list[Rows]:
    """Groups of bad pieces of path that touch, in the order of time."""
    pieces = np.flatnonzero(bad)
    pieces = pieces[np.argsort(last[pieces], kind="stable")]
    if len(pieces) == 0:
        return []
    reached = np.maximum.accumulate(last[pieces])
    new = np.flatnonzero(first[pieces][1:] > reached[:-1]) + 1
    return np.split(pieces, new)


def _last_departure(matched: Association, first: Rows, last: Rows, found: tuple[int, int]) -> tuple[int, int]:
    """Rows at which an excursion that does not heal begins, and is bad: after the last row at which the estimate fits
    the truth as at the start of the run, where it does so in between; else those that were found.

    first, last (k,): rows of its bad pieces of path
    """
    path, true, estimated = matched.reference.distance, matched.reference.poses, matched.estimate.poses
    aligned = np.flatnonzero(path <= HEAL_PATH)
    rows = np.arange(found[0], int(last.max()) + 1)
    miss = between(true[rows], compose(_mean_alignment(true[aligned], estimated[aligned]), estimated[rows]))
    metres, degrees = np.hypot(miss[:, 0], miss[:, 1]), np.degrees(np.abs(miss[:, 2]))
    fits = rows[np.asarray(has_come_back(metres, degrees, path[rows]))]
    after = np.flatnonzero(first >= fits[-1]) if len(fits) else np.zeros(0, np.intp)
    if len(after) == 0:
        return found
    begin = int(first[after].min())
    return begin, _moment(matched, begin, int(last[after[0]]))


def _with_worst(blip: Blip, translation: NDArray[np.float64], rotation: NDArray[np.float64], pieces: Rows) -> Blip:
    """A blip to which further bad pieces of path belong."""
    metres, degrees = float(translation[pieces].max()), float(rotation[pieces].max())
    return replace(blip, metres=max(blip.metres, metres), degrees=max(blip.degrees, degrees))


def _passes(matched: Association, begin: int, end: int) -> bool:
    """Whether the motion from the row at which an excursion begins to that of its end is right, as after a jump there
    and back; the estimate may drift away from there all the same."""
    rows = np.array([begin]), np.array([end])
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, rows)
    path = matched.reference.distance
    return bool(has_come_back(float(translation[0]), float(rotation[0]), float(path[end] - path[begin])))


def _back_at(matched: Association, begin: int, end: int, next_begin: int | None) -> int | None:
    """The row from which the estimate fits the truth again as it did before the row `begin`, or at the start of the
    run; None where it never does.

    Rows up to `end` are those of the excursion; the next one begins at the row `next_begin`, None = there is none.
    """
    path = matched.reference.distance
    before = np.flatnonzero((path <= path[begin]) & (path >= path[begin] - HEAL_PATH))
    at_start = np.flatnonzero(path <= HEAL_PATH)
    after = np.arange(min(end + 1, len(path) - 1), len(path))
    found = [_first_fit(matched, begin, after, rows, next_begin) for rows in (before, at_start)]
    return min((row for row in found if row is not None), default=None)


def _first_fit(matched: Association, begin: int, after: Rows, aligned: Rows, next_begin: int | None) -> int | None:
    """The first of the rows `after` an excursion from which the estimate fits the truth for long enough, aligned to it
    over the rows `aligned`; None where there is none. The excursion begins at the row `begin`.
    """
    path, true, estimated = matched.reference.distance, matched.reference.poses, matched.estimate.poses
    T_truth_estimate = _mean_alignment(true[aligned], estimated[aligned])
    miss = between(true[after], compose(T_truth_estimate, estimated[after]))
    metres, degrees = np.hypot(miss[:, 0], miss[:, 1]), np.degrees(np.abs(miss[:, 2]))
    good = np.asarray(has_come_back(metres, degrees, path[after] - path[begin]))
    needed = min(HEAL_PATH, float(path[-1] - path[after[0]])) - 1e-6
    for run in np.split(np.arange(len(good)), np.flatnonzero(np.diff(good.astype(np.int8))) + 1):
        first, last = after[run[0]], after[run[-1]]
        until_next = next_begin is not None and last >= next_begin
        enough = MIN_HEAL_PATH if until_next else needed
        if good[run[0]] and path[last] - path[first] >= enough:
            return int(first)
    return None


def has_come_back(metres: Numbers, degrees: Numbers, driven: Numbers) -> Numbers:
    """Whether an estimate that is off by so much [m], [deg] fits the truth again, so much of the path [m] after it had
    left it: the rule of `HEAL_M`, for numbers or arrays (n,)."""
    since = np.minimum(driven, HEAL_DRIFT_PATH)
    return (metres <= HEAL_M + HEAL_DRIFT_M * since) & (degrees <= HEAL_DEG + HEAL_DRIFT_DEG * since)


def _mean_alignment(true: Pose, estimated: Pose) -> Pose:
    """The pose (3,) that moves estimated poses (n, 3) onto true ones, on average."""
    turn = true[:, 2] - estimated[:, 2]
    theta = float(np.arctan2(np.sin(turn).mean(), np.cos(turn).mean()))
    turned = compose(np.array([0.0, 0.0, theta]), estimated)
    offset = (true[:, :2] - turned[:, :2]).mean(axis=0)
    return np.array([offset[0], offset[1], theta])


def _moment(matched: Association, begin: int, end: int) -> int:
    """The first row after `begin` at which half of what makes a metre bad has come about, and has not gone at the next
    one."""
    rows = np.arange(begin + 1, end + 1)
    wrong = _severity(matched, begin, rows) > 0.5
    lasting = np.flatnonzero(wrong & np.append(wrong[1:], True))
    return int(rows[lasting[0]]) if len(lasting) else end


def _departure(matched: Association, begin: int, end: int) -> tuple[int, int]:
    """The row from which on an error comes about, and the row at which half of what makes a metre bad has.

    A pose that is off by itself, at a single update, is neither: where that at `begin` is, the row before it takes its
    place.
    """
    moment = _moment(matched, begin, end)
    if begin == 0:
        return begin, moment
    alone, then = _severity(matched, begin - 1, np.array([begin, moment])).tolist()
    if alone > 0.5 and then <= 0.5:
        return begin - 1, _moment(matched, begin - 1, end)
    return begin, moment


def _severity(matched: Association, begin: int, rows: Rows) -> NDArray[np.float64]:
    """How wrong the motions from the row `begin` to other rows (n,) are, in units of what makes a metre bad, (n,)."""
    pairs = (np.full(len(rows), begin), rows)
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, pairs)
    severity: NDArray[np.float64] = np.maximum(translation / BAD_M, rotation / BAD_DEG)
    return severity


def _open_loop(matched: Association) -> tuple[int, int] | None:
    """Rows of the first visit and of the return that shows an open loop; None where enough loops close."""
    first, last = loop_pairs(matched)
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, (first, last))
    wrong = (translation > LOOP_M) | (rotation > LOOP_DEG)
    if len(wrong) == 0 or wrong.mean() <= LOOP_SHARE:
        return None
    at = np.flatnonzero(wrong)[np.argmin(last[wrong])]
    return int(first[at]), int(last[at])


def _failure_of_loop(
    matched: Association, first: int, last: int, excursions: list[tuple[int, int, int]], blips: list[Blip]
) -> Failure:
    """The failure that an open loop shows: at the return, or where one of its two visits falls into an excursion that
    healed, at that excursion. What the robot saw in it lies at a wrong place of the map.

    excursions: rows at which each one began, was bad, and was over, in the order of `blips`
    """
    rows = np.array([first]), np.array([last])
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, rows)
    amount, stamps = _amount(translation[0], rotation[0]), matched.estimate.stamps
    for number, (begin, moment, back) in enumerate(excursions):
        if any(begin < visit <= back for visit in (first, last)):
            reason = (
                f"for {stamps[back] - stamps[moment]:.1f} s the path lies elsewhere than before and after; what it saw "
                f"meanwhile lies at a wrong place, off by {amount} from what another visit saw there"
            )
            others = blips[:number] + blips[number + 1 :]
            failure = _failure(matched, begin, moment, reason, bad=True, blips=others)
            return replace(failure, back=float(stamps[back]))
    ago = stamps[last] - stamps[first]
    reason = f"the robot is back where it was {ago:.0f} s before, and the estimate is off by {amount}"
    return _failure(matched, first, last, reason, bad=True, blips=blips)


def _shown(matched: Association, begin: int, moment: int) -> int:
    """The row that shows a moment best: the moment itself where the motion since the row `begin` is then clearly wrong,
    else the row up to `SHOWN_S` after it at which it is most wrong."""
    stamps = matched.estimate.stamps
    rows = moment + np.flatnonzero(np.abs(stamps[moment:] - stamps[moment]) <= SHOWN_S)
    severity = _severity(matched, begin, rows)
    return moment if severity[0] >= CLEAR_SEVERITY else int(rows[np.argmax(severity)])


def _soon_after(matched: Association, begin: int, moment: int) -> str:
    """How the estimate is wrong at a moment or soon after it: by a jump, or since the row `begin`."""
    estimated, true, stamps = matched.estimate.poses, matched.reference.poses, matched.estimate.stamps
    step = np.array([max(moment - 1, 0)]), np.array([moment])
    translation, rotation = pair_errors(estimated, true, step)
    if translation[0] > BAD_M or rotation[0] > BAD_DEG:
        jump, driven = (between(poses[step[0][0]], poses[moment]) for poses in (estimated, true))
        return f"with this one update it moves by {_motion(jump)}, the robot by {_motion(driven)}"
    shown = _shown(matched, begin, moment)
    translation, rotation = pair_errors(estimated, true, (np.array([begin]), np.array([shown])))
    when = "here" if shown == moment else f"{stamps[shown] - stamps[moment]:.1f} s later"
    return f"{when} it is off by {_amount(translation[0], rotation[0])}"


def _failure(matched: Association, begin: int, moment: int, reason: str, *, bad: bool, blips: list[Blip]) -> Failure:
    """The failure at a row, measured from another one on."""
    true, estimated = matched.reference.poses, matched.estimate.poses
    shown = _shown(matched, begin, moment) if bad else moment
    return Failure(
        scan=int(matched.rows[moment]),
        since=int(matched.rows[begin]),
        stamp=float(matched.estimate.stamps[moment]),
        bad=bad,
        reason=reason,
        shown_scan=int(matched.rows[shown]),
        estimated=compose(true[begin], between(estimated[begin], estimated[shown])),
        true_pose=true[shown],
        blips=tuple(blips),
    )


def first_bad_relation(estimate: Trajectory, dense: Trajectory, relations: Relations) -> Failure | None:
    """The scan at which a relation to an earlier one is first wrong by more than `LOOP_M` or `LOOP_DEG`; or None."""
    error = relation_error(dense, relations)
    wrong = (error.translation_errors > LOOP_M) | (error.rotation_errors > LOOP_DEG)
    if not wrong.any():
        return None
    known = error.matched[wrong]
    later = np.maximum(relations.first, relations.second)[known]
    at = int(np.argmin(later))
    one, two = float(relations.first[known[at]]), float(relations.second[known[at]])
    motion = relations.poses[known[at]]
    if one > two:  # the relation looks back in time
        one, two, motion = two, one, between(motion, np.zeros(3))
    before, now = _nearest(dense, one), _nearest(dense, two)
    amount = _amount(error.translation_errors[wrong][at], error.rotation_errors[wrong][at])
    return Failure(
        scan=_nearest(estimate, two),
        since=_nearest(estimate, one),
        stamp=two,
        bad=True,
        shown_scan=_nearest(estimate, two),
        reason=f"a hand-checked relation to where it was {two - one:.0f} s before shows that it is off by {amount}",
        estimated=dense.poses[now],
        true_pose=compose(dense.poses[before], motion),
    )


def first_bad_match(estimate: Trajectory, steps: Columns) -> Failure | None:
    """Without truth: the first scan that did not fit the map; where there is none, the one that fitted worst."""
    rows = np.flatnonzero(updates(steps))[1:]  # the first scan meets an empty map
    rows = rows[rows < len(estimate)]
    if len(rows) == 0:
        return None
    share = column(steps, "matched_share")[rows]
    failed = column(steps, "match_failures")[rows] / column(steps, "particles")[rows]
    usual = float(np.nanmedian(share))
    if not usual > 0.0:
        return None
    bad = np.flatnonzero((share < BAD_MATCHED_SHARE * usual) | (failed > BAD_FAILURE_SHARE))
    at = int(bad[0]) if len(bad) else int(np.nanargmin(share))
    numbers = f"{share[at]:.0%} of its beams met walls of the map (usual: {usual:.0%})"
    if failed[at] > 0.0:
        numbers += f", and scan matching failed for {failed[at]:.0%} of the particles"
    return Failure(
        scan=int(rows[at]),
        since=int(rows[at]),
        stamp=float(column(steps, "stamp")[rows[at]]),
        bad=bool(len(bad)),
        reason=numbers if len(bad) else f"every scan fitted the map; this one fitted worst: {numbers}",
        shown_scan=int(rows[at]),
        estimated=estimate.poses[rows[at]],
        true_pose=None,
    )


def _nearest(trajectory: Trajectory, stamp: float) -> int:
    """Row of the first of the nearest stamps."""
    return int(np.argmin(np.abs(trajectory.stamps - stamp)))


def _motion(motion: Pose) -> str:
    return _amount(float(np.hypot(motion[0], motion[1])), abs(float(np.degrees(motion[2]))))


def _amount(metres: float | NDArray[np.float64], degrees: float | NDArray[np.float64]) -> str:
    return f"{length(float(metres))} and {degrees:.1f} degrees"
