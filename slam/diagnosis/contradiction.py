# SPDX-License-Identifier: MIT
"""The verdict on an estimate, scan by scan: is the map contradicted by more than people and noise explain?

A cumulated sum (CUSUM: Page, "Continuous Inspection Schemes", Biometrika 41, 1954) adds up, over the scans, the share
of the beams that contradict the map as it was before the scan, less an allowance for what moves in the world:

    S <- max(0, S + (contradicting - ALLOWANCE * judged) / compared)

Its unit is whole scans that contradict. One scan whose every beam is wrong counts as much as ten of which a tenth is,
above the allowance; a few wrong beams in each scan of a lively place add up to nothing. A map with two versions of one
place contradicts each scan that sees both, until newer beams have erased the older walls.

A jump that nothing asked for is the second kind of evidence: the estimate leaves the pose where the wheels put it,
although the map did not contradict the scan there. The third is a stretch of the way on which the scans see next to
nothing, or hold the estimate in one direction only (`unheld_directions`): there it rests on the wheels alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from slam import se2
from slam.diagnosis.beam_check import BeamEvidence
from slam.diagnosis.plain_parts import part_of, plain_pose
from slam.diagnosis.unheld_directions import MAX_ERROR_M, Hold, UnheldDirections

Verdict = Literal["plausible", "doubtful", "lost"]

ALLOWANCE = 0.12
"""Share of the judged beams that may contradict the map all the time: people, doors, glass."""
DOUBTFUL_SUM = 0.2
"""An estimate is doubtful from this sum on [scans]."""
LOST_SUM = 0.5
"""An estimate is lost from this sum on [scans]."""
ONE_SIDED_SHARE, ONE_SIDED_SUM = 0.05, 5.0
"""If less than this share of the contradicting beams is of the other kind, the place may have changed: a door that
opened only lets beams through, a crowd only stops them, a wrong pose does both. Lost then means this sum [scans]."""
MIN_COMPARED = 20
"""A scan of which fewer beams were compared counts for less than a scan."""
JUMP_M, JUMP_RAD = 0.5, 0.35
"""The estimate jumps if a scan moves it by more than either from where the wheels predict it."""
NEEDLESS_SHARE = 0.05
"""A jump is needless if fewer of the beams than this share contradict the map at the predicted pose."""
MIN_SEEN = 10
"""A scan is blind if the map says something of fewer beams."""
MAX_BLIND_M = 2.0
"""An estimate is doubtful if it was blind for longer than this [m]."""


class ScanEvidence(NamedTuple):
    """What one scan says of an estimate."""

    beams: BeamEvidence
    """What the map says of its beams."""
    jump: se2.Pose | None
    """The displacement (3,) by which the estimate left the wheels without need; None = it did not."""
    hold: Hold
    """In which directions it holds the estimate, and what the wheels say."""


@dataclass(frozen=True)
class SelfCheck:
    """What the evidence of an estimate itself, without any truth, says of it."""

    verdict: Verdict
    """plausible: nothing speaks against it; lost: the scans contradict the map for too long; doubtful: in between."""
    reason: str
    """What was seen, with its numbers."""
    stamp: float | None = None
    """When the contradiction began [s]; None if there is none."""
    place: tuple[float, float, float] | None = None
    """Estimated pose of the robot then [m, m, rad]."""


PLAUSIBLE = SelfCheck("plausible", "the scans agree with the map")


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Consecutive scans that contradict the map."""

    stamp: float
    """When it began [s]."""
    place: tuple[float, float, float]
    """Estimated pose of the robot then [m, m, rad]."""
    total: float = 0.0
    """The sum S [scans]."""
    scans: int = 0
    """Number of scans."""
    judged: int = 0
    """Beams of which the map says something."""
    through: int = 0
    """Beams that cross a wall of the map."""
    short: int = 0
    """Beams that end in free space of the map."""

    @property
    def check(self) -> SelfCheck:
        """The verdict on an estimate with this stretch in it."""
        if self.total < DOUBTFUL_SUM:
            return PLAUSIBLE
        contradicting = self.through + self.short
        scans = f"in {self.scans} scans" if self.scans > 1 else "in one scan"
        reason = (
            f"{scans} {contradicting / max(self.judged, 1):.0%} of the beams contradict the map: {self.through} cross "
            f"known walls, {self.short} end in space known to be free"
        )
        one_sided = min(self.through, self.short) < ONE_SIDED_SHARE * contradicting
        if one_sided and LOST_SUM <= self.total < ONE_SIDED_SUM:
            reason += "; nearly all of one kind, as where the place has changed"
        lost = self.total >= (ONE_SIDED_SUM if one_sided else LOST_SUM)
        return SelfCheck("lost" if lost else "doubtful", reason, self.stamp, self.place)


@dataclass(frozen=True, kw_only=True)
class Jump:
    """A jump of the estimate that nothing asked for."""

    stamp: float
    """When it happened [s]."""
    place: tuple[float, float, float]
    """Estimated pose of the robot after it [m, m, rad]."""
    metres: float
    """How far the estimate moved away from the pose that the wheels predict [m]."""
    degrees: float
    """By how much it turned away from it [deg]."""

    @property
    def check(self) -> SelfCheck:
        """The verdict on an estimate with this jump in it."""
        reason = (
            f"the estimate jumps by {self.metres:.2f} m and {self.degrees:.0f} degrees away from the wheels, although "
            "the map contradicted no scan where they put the robot"
        )
        return SelfCheck("doubtful", reason, self.stamp, self.place)


@dataclass(frozen=True, kw_only=True)
class BlindStretch:
    """Consecutive scans that see next to nothing."""

    stamp: float
    """When it began [s]."""
    place: tuple[float, float, float]
    """Estimated pose of the robot then [m, m, rad]."""
    metres: float
    """How far the robot has driven since, by the estimate [m]."""

    @property
    def check(self) -> SelfCheck:
        """The verdict on an estimate with this stretch in it."""
        if self.metres <= MAX_BLIND_M:
            return PLAUSIBLE
        reason = (
            f"over {self.metres:.1f} m fewer than {MIN_SEEN} beams of each scan meet anything known: the estimate "
            "rests on the wheels alone"
        )
        return SelfCheck("doubtful", reason, self.stamp, self.place)


class ContradictionMonitor:
    """Follows the evidence over the scans of an estimate."""

    def __init__(self) -> None:
        """Begin without a contradiction."""
        self.max_total = 0.0
        """The largest sum S so far [scans]."""
        self._present: Stretch | None = None
        self._worst: Stretch | None = None
        self._jump: Jump | None = None  # the first needless one
        self._last: tuple[float, float, float] | None = None  # estimated pose at the last scan
        self._blind: BlindStretch | None = None
        self._longest_blind: BlindStretch | None = None
        self._directions = UnheldDirections()

    @property
    def total(self) -> float:
        """The sum S after the last scan [scans]."""
        return 0.0 if self._present is None else self._present.total

    @property
    def overall(self) -> SelfCheck:
        """The verdict on the whole estimate so far."""
        found = [part.check for part in (self._worst, self._jump, self._longest_blind) if part is not None]
        found += [_check_missing(self._directions), _check_unheld(self._directions)]
        bad = [check for check in found if check.verdict != "plausible"]
        return next((check for check in bad if check.verdict == "lost"), next(iter(bad), PLAUSIBLE))

    @property
    def present(self) -> SelfCheck:
        """The verdict at the last scan: an estimate that was lost stays doubtful, since its map may be double."""
        now = PLAUSIBLE if self._present is None else self._present.check
        overall = self.overall
        if now.verdict == "lost" or overall.verdict == "plausible":
            return now
        missing = _check_missing(self._directions)
        if missing.verdict == "lost" and self._directions.still_missing:
            return missing
        return replace(overall, verdict="doubtful")

    def update(self, stamp: float, pose: se2.Pose, evidence: ScanEvidence) -> None:
        """Take in the evidence of a scan that was taken at a time [s] and an estimated pose (3,)."""
        if evidence.jump is not None and self._jump is None:
            metres, degrees = float(np.hypot(*evidence.jump[:2])), float(np.degrees(abs(evidence.jump[2])))
            self._jump = Jump(stamp=stamp, place=plain_pose(pose), metres=metres, degrees=degrees)
        beams = evidence.beams
        self._note_sight(stamp, plain_pose(pose), beams)
        self._directions.update(float(stamp), plain_pose(pose), evidence.hold)
        compared = max(beams.judged + beams.unknown, MIN_COMPARED)
        total = self.total + (beams.contradicting - ALLOWANCE * beams.judged) / compared
        if total <= 0.0:
            self._present = None
            return
        before = self._present or Stretch(stamp=stamp, place=plain_pose(pose))
        self._present = replace(
            before,
            total=total,
            scans=before.scans + 1,
            judged=before.judged + beams.judged,
            through=before.through + beams.through,
            short=before.short + beams.short,
        )
        self.max_total = max(self.max_total, total)
        if self._worst is None or _severity(self._present) > _severity(self._worst):
            self._worst = self._present

    def _note_sight(self, stamp: float, place: tuple[float, float, float], beams: BeamEvidence) -> None:
        """Note whether a scan, taken at a time [s] and an estimated pose, sees anything known."""
        last, self._last = self._last or place, place
        if beams.judged >= MIN_SEEN:
            self._blind = None
            return
        before = self._blind or BlindStretch(stamp=stamp, place=place, metres=0.0)
        step = float(np.hypot(place[0] - last[0], place[1] - last[1]))
        self._blind = replace(before, metres=before.metres + step)
        if self._longest_blind is None or self._blind.metres > self._longest_blind.metres:
            self._longest_blind = self._blind

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        parts = {
            "present": self._present,
            "worst": self._worst,
            "jump": self._jump,
            "blind": self._blind,
            "longest_blind": self._longest_blind,
        }
        plain: dict[str, Any] = {name: None if part is None else asdict(part) for name, part in parts.items()}
        return {**plain, "last": self._last, "max_total": self.max_total, "directions": self._directions.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._present, self._worst = (part_of(Stretch, state[name]) for name in ("present", "worst"))
        self._blind, self._longest_blind = (part_of(BlindStretch, state[name]) for name in ("blind", "longest_blind"))
        self._jump = part_of(Jump, state["jump"])
        self.max_total = float(state["max_total"])
        self._directions.restore(state["directions"])
        self._last = None if state["last"] is None else plain_pose(state["last"])


def _check_missing(directions: UnheldDirections) -> SelfCheck:
    """The verdict that follows from the way that the wheels may not have counted."""
    way = directions.missing
    if way is None:
        return PLAUSIBLE
    reason = (
        f"for {way.seconds:.1f} s the wheels counted less or backward at once, and then as before at once, as a robot "
        f"cannot drive, in a direction in which no wall in sight holds the estimate: {way.metres:.1f} m are missing"
    )
    return SelfCheck("lost", reason, way.stamp, way.place)


def _check_unheld(directions: UnheldDirections) -> SelfCheck:
    """The verdict that follows from the way that was driven by the wheels alone."""
    if directions.worst is None:
        return PLAUSIBLE
    stretch, possible = directions.worst
    if possible <= MAX_ERROR_M:
        return PLAUSIBLE
    reason = (
        f"for {stretch.seconds:.1f} s nothing but the wheels told how far the robot drove in one direction, "
        f"{stretch.metres:.1f} m of way: up to {possible:.1f} m may be missing"
    )
    return SelfCheck("doubtful", reason, stretch.stamp, stretch.place)


def _severity(stretch: Stretch) -> tuple[bool, float]:
    """What orders two stretches of an estimate: whether it is lost by them, then the sum."""
    return stretch.check.verdict == "lost", stretch.total


def is_jump(displacement: se2.Pose) -> bool:
    """Whether a displacement (3,) of the estimate from where the wheels predict it is a jump."""
    return bool(np.hypot(*displacement[:2]) > JUMP_M or abs(displacement[2]) > JUMP_RAD)


def is_needless(beams: BeamEvidence) -> bool:
    """Whether the map hardly contradicts a scan at the predicted pose, which a jump of the estimate has left."""
    return beams.contradicting < NEEDLESS_SHARE * max(beams.judged + beams.unknown, 1)
