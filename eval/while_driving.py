# SPDX-License-Identifier: MIT
"""When the pose while driving was off the truth, and how much of a bad outcome comes from each of these times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.consistency import LEVEL, chi_square
from eval.failure_cause import MIN_SLIP_DEG, MIN_SLIP_M, another_best, closes_loop, earlier_slips, find_cause
from eval.filter.nees import nees
from eval.filter.step_table import Columns, column, updates
from eval.first_failure import HEAL_PATH
from eval.loss_watch import Spell, spells
from eval.outcome import LOCAL_DEG, LOCAL_M, LOOP_DEG, LOOP_M, LOOP_SHARE, Evidence, evidence_from_truth, loop_pairs
from eval.trajectory.association import Association, associate
from eval.trajectory.errors import stretches
from eval.trajectory.trajectory import Trajectory
from eval.wording import at_time, length, share
from slam.se2 import between, compose, inverse

TOUCH_S = 0.01
"""Times with less between them are one [s]."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A run while it drives: its pose at the scans, the true one, the table of steps, and the wheels' poses."""

    online: Trajectory
    truth: Trajectory
    steps: Columns
    odometry: Trajectory | None = None

    def at_updates(self, name: str) -> NDArray[np.float64]:
        """Return a column of the table at the updates of the filter, (updates,)."""
        return column(self.steps, name)[updates(self.steps)]


@dataclass(frozen=True)
class Stretch:
    """A time in which the pose while driving was off the truth. Stamps [s]."""

    start: float
    """When the pose left the truth."""
    moment: float
    """What to look at: the beginning, or where it was lost."""
    spells: tuple[Spell, ...]
    """The times of the recording's event log that it is made of, in their order."""
    end: float | None
    """When it was back for at least `eval.first_failure.HEAL_PATH` of driving; None = not by the end of the run."""
    worst: float
    """When it was most wrong …"""
    metres: float
    """… and by how much [m]."""
    errors: tuple[float, float]
    """Position errors at the update before the moment, and at it [m]."""
    sudden: bool
    """Whether it began with one update; else the error grew little by little."""
    cause: str
    """How it began, as a sentence."""
    ended: str
    """How it ended, as a sentence; empty where there is nothing to say."""
    share: float
    """What part of the evidence for the outcome comes from it, 0 to 1."""


@dataclass(frozen=True)
class WhileDriving:
    """The times in which the pose while driving was off the truth, and what its outcome rests on."""

    stretches: tuple[Stretch, ...]
    """The one from which most of the evidence comes first."""
    evidence: str
    """What the outcome rests on, e.g. that 14 % of the pairs of visits to one place do not meet."""
    part_of: str
    """What the shares are of, in words."""
    rule: str
    """What counts as evidence, and for which time, as a sentence; empty where nothing is to be explained."""
    behind: str
    """What made the most important one possible, as a sentence; empty where the data do not say."""

    @property
    def first(self) -> Stretch:
        """The earliest one."""
        return min(self.stretches, key=lambda stretch: stretch.start)

    @property
    def worst(self) -> Stretch:
        """The one with the largest error."""
        return max(self.stretches, key=lambda stretch: stretch.metres)

    @property
    def last(self) -> Stretch:
        """The latest one."""
        return max(self.stretches, key=lambda stretch: stretch.start)

    def times_in_words(self, stretch: Stretch, start: float) -> str:
        """When the pose was off, since a start [s], as the event log has it: 81.7 to 181.1 s and 185.6 to 210.5 s."""
        return " and ".join(
            f"{at_time(spell.start - start).removesuffix(' s')} to "
            f"{'the end' if spell.end is None else at_time(spell.end - start)}"
            for spell in stretch.spells
        )

    def part_in_words(self, stretch: Stretch) -> str:
        """What part of the evidence comes from a time."""
        return f"{share(stretch.share) if stretch.share > 0.0 else 'none'} {self.part_of}"

    def back_in_words(self, stretch: Stretch, start: float) -> str:
        """When the pose was back after a time, since a start [s]."""
        if stretch.end is None:
            return "not back by the end"
        return f"back {'for good ' if stretch is self.last else ''}at {at_time(stretch.end - start)}"

    def largest_in_words(self, stretch: Stretch, start: float) -> str:
        """The largest error in a time, and when it was so large, since a start [s]."""
        largest = ", the largest error while driving" if stretch is self.worst else ""
        return f"up to {length(stretch.metres)} off (at {at_time(stretch.worst - start)}{largest})"


def judge_while_driving(outcome: str, drive: Drive) -> WhileDriving | None:
    """Explain a bad outcome of the pose while driving; None where it never was off the truth, or that is unknown.

    outcome: `lost`, `broken loop` or `drift`

    The times are those of the recording's event log (`eval.loss_watch`); two of them with less driving between than
    `HEAL_PATH` are one. A pair of visits that do not meet counts for the visit at which the pose was further off.
    Raises AssociationError where truth and poses have no time in common.
    """
    steps = drive.steps
    found = sorted(spells(steps, "drifted") + spells(steps, "lost"), key=lambda spell: spell.start)
    if not found or "error_m" not in steps:
        return None
    matched = associate(drive.online, drive.truth)
    weights, evidence, part_of, rule = _evidence(outcome, matched)
    total = float(weights.sum())
    lost = [spell.start for spell in spells(steps, "lost")] if outcome == "lost" else []
    parts = []
    for together in _joined(found, matched):
        within = _within(matched.estimate.stamps, Spell(together[0].start, together[-1].end))
        part = float(weights[within].sum()) / total if total > 0.0 else 0.0
        parts.append(_stretch(together, part, lost, drive))
    parts.sort(key=lambda stretch: (stretch.share, stretch.metres), reverse=True)
    return WhileDriving(tuple(parts), evidence, part_of, rule, _behind(parts, drive))


def _evidence(outcome: str, matched: Association) -> tuple[NDArray[np.float64], str, str, str]:
    """Weight of each pose in what an outcome rests on, (n,), that in words, what shares of it are of, and the rule."""
    evidence = evidence_from_truth(matched)
    weights = np.zeros(len(matched.rows))
    if outcome == "lost":
        first, _ = stretches(matched, 1.0)
        bad = (evidence.local[0] > LOCAL_M) | (evidence.local[1] > LOCAL_DEG)
        np.add.at(weights, first[bad], evidence.local_weights[bad])
        words = (
            f"on {weights.sum():.1f} m of the path the motion over the next metre is wrong by more than "
            f"{LOCAL_M} m or {LOCAL_DEG:.0f} degrees (limit {evidence.local_limit} m)"
        )
        return weights, words, "of the metres that are wrong", ""
    metres, degrees = _errors_from_start(matched)
    if outcome == "broken loop":
        return _bad_visits(matched, evidence, np.maximum(metres / LOOP_M, degrees / LOOP_DEG))
    words = f"its trajectory error (ATE) is {length(evidence.whole_m)}"
    return metres**2, words, "of the squared error", ""


def _bad_visits(
    matched: Association, evidence: Evidence, severity: NDArray[np.float64]
) -> tuple[NDArray[np.float64], str, str, str]:
    """The same for a broken loop; severity (n,): how far each pose is off."""
    first, last = loop_pairs(matched)
    bad = (evidence.loops[0] > LOOP_M) | (evidence.loops[1] > LOOP_DEG)
    weights = np.zeros(len(matched.rows))
    np.add.at(weights, np.where(severity[first] >= severity[last], first, last)[bad], 1.0)
    words = (
        f"{share(float(bad.mean()))} of the {len(bad)} pairs of visits to one place do not meet "
        f"(limit {100.0 * LOOP_SHARE:.0f}\N{NO-BREAK SPACE}%)"
    )
    rule = (
        "Two visits are a pair where they lie within 1 m of each other, with 10 m of driving or more between; they do "
        f"not meet where the motion between them is wrong by more than {length(LOOP_M)} or {LOOP_DEG:.0f}°, and count "
        "for the time of the visit at which the pose was further off."
    )
    return weights, words, "of the pairs that do not meet", rule


def _errors_from_start(matched: Association) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors of all poses, aligned at the first one, [m] and [deg], (n,)."""
    true, estimated = matched.reference.poses, matched.estimate.poses
    miss = between(true, compose(compose(true[0], inverse(estimated[0])), estimated))
    return np.hypot(miss[:, 0], miss[:, 1]), np.degrees(np.abs(miss[:, 2]))


def _joined(found: list[Spell], matched: Association) -> list[list[Spell]]:
    """Spells in the order of time, those with little driving between together."""
    path, stamps = matched.reference.distance, matched.estimate.stamps
    joined = [found[:1]]
    for spell in found[1:]:
        end = joined[-1][-1].end
        driven = 0.0 if end is None else float(np.diff(np.interp([end, spell.start], stamps, path))[0])
        if driven < HEAL_PATH:
            joined[-1].append(spell)
        else:
            joined.append([spell])
    return joined


def _behind(stretches: list[Stretch], drive: Drive) -> str:
    """Say of the first time by how far the pose, and with it the map, had been off before, how often the wheels had
    slipped before it, and how often the particles covered the truth in it."""
    stretch, parts = stretches[0], []
    if earlier := [other for other in stretches if other.start < stretch.start]:
        off = length(max(other.metres for other in earlier))
        parts.append(f"the map was bent before, drawn while the pose was up to {off} off")
    if drive.odometry is not None:
        slips, _ = earlier_slips(drive.odometry, drive.truth, stretch.start)
        if slips:
            parts.append(f"the wheels slipped in {slips} before it")
    rows, values, _ = nees(drive.steps)
    inside = _within(column(drive.steps, "stamp")[rows], Spell(stretch.start, stretch.end))
    particles = int(drive.at_updates("particles").max())
    if inside.any() and particles > 1:
        outside = float(np.mean(values[inside] > chi_square(LEVEL, 3)))
        if outside > 0.5:
            at = "all updates" if outside == 1.0 else f"{share(outside)} of the updates"
            first = float(drive.online.stamps[0])
            end = "to the end" if stretch.end is None else f"to {at_time(stretch.end - first)}"
            parts.append(
                f"the {particles} particles did not cover the truth: it lay outside their {share(LEVEL)} ellipse at "
                f"{at} from {at_time(stretch.start - first)} {end}"
            )
    return ", and ".join(parts)


def _merged(found: list[Spell]) -> tuple[Spell, ...]:
    """Spells in the order of time, those that touch as one: a drift ends where a loss begins."""
    merged = found[:1]
    for spell in found[1:]:
        if merged[-1].end is None or spell.start - merged[-1].end < TOUCH_S:
            merged[-1] = Spell(merged[-1].start, spell.end)
        else:
            merged.append(spell)
    return tuple(merged)


def _within(stamps: NDArray[np.float64], spell: Spell) -> NDArray[np.bool_]:
    """Which stamps (n,) lie in a spell; at its end the pose is back."""
    return (stamps >= spell.start) & (stamps < (np.inf if spell.end is None else spell.end))


def _stretch(together: list[Spell], part: float, lost: list[float], drive: Drive) -> Stretch:
    """Describe one of the times, made of spells; lost: when losses began [s]."""
    spell = Spell(together[0].start, together[-1].end)
    stamps, metres = drive.at_updates("stamp"), drive.at_updates("error_m")
    inside = np.where(_within(stamps, spell), metres, np.nan)
    worst = int(np.nanargmax(inside))
    start = _jump_before(spell.start, drive)
    sudden = start is not None
    start = spell.start if start is None else start
    losses = [stamp for stamp in lost if _within(np.array([stamp]), spell)[0]]
    moment = losses[0] if losses else start
    now = int(np.searchsorted(stamps, moment - 1e-6))
    errors = float(metres[max(now - 1, 0)]), float(metres[now])
    cause = _beginning(moment, sudden or bool(losses), errors, drive)
    return Stretch(
        start=start,
        moment=moment,
        spells=_merged([Spell(start, together[0].end), *together[1:]]),
        end=spell.end,
        worst=float(stamps[worst]),
        metres=float(metres[worst]),
        errors=errors,
        sudden=sudden or bool(losses),
        cause=cause,
        ended="" if spell.end is None else _return(spell.end, drive),
        share=part,
    )


def _jump_before(stamp: float, drive: Drive) -> float | None:
    """The update up to a stamp [s], and at most `HEAL_PATH` of driving before it, at which the error grew most; None
    where it grew at each of them by less than what a slip of the wheels makes."""
    stamps = drive.at_updates("stamp")
    path = np.interp(stamps, drive.truth.stamps, drive.truth.distance)
    now = int(np.searchsorted(stamps, stamp - 1e-6))
    growth = np.maximum(
        np.diff(drive.at_updates("error_m"), prepend=np.nan) / MIN_SLIP_M,
        np.diff(drive.at_updates("error_deg"), prepend=np.nan) / MIN_SLIP_DEG,
    )
    near = (np.arange(len(stamps)) <= now) & (path >= path[now] - HEAL_PATH)
    growth = np.where(near & np.isfinite(growth), growth, 0.0)
    most = int(np.argmax(growth))
    return float(stamps[most]) if growth[most] >= 1.0 else None


def _beginning(stamp: float, sudden: bool, errors: tuple[float, float], drive: Drive) -> str:
    """Say how the pose left the truth at an update [s]; errors: at the update before and at it [m]."""
    steps = drive.steps
    jump = another_best(stamp, steps)
    if jump is not None and errors[1] > errors[0]:
        known = " as old walls came into view again" if closes_loop(stamp, steps) else ""
        return f"{jump}{known}, away from the truth ({length(errors[0])} to {length(errors[1])} off)"
    whole = steps if "hits" in steps else None  # tables of older releases have none
    cause = None
    if sudden:
        cause = find_cause(stamp, odometry=drive.odometry, reference=drive.truth, steps=whole, estimate=drive.online)
    if cause is not None:
        return cause
    if sudden:
        return f"with one update the error went from {length(errors[0])} to {length(errors[1])}; the data show no fault"
    return f"the error grew little by little, to {length(errors[1])}: no single fault"


def _return(end: float, drive: Drive) -> str:
    """Say how the pose came back at an update [s]; empty where there is nothing to say."""
    stamps, metres = drive.at_updates("stamp"), drive.at_updates("error_m")
    now = int(np.searchsorted(stamps, end - 1e-6))
    if another_best(end, drive.steps) is None or now == 0 or not metres[now] < metres[now - 1]:
        return ""
    return f"another particle became the best ({length(float(metres[now - 1]))} to {length(float(metres[now]))} off)"
