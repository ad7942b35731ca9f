# SPDX-License-Identifier: MIT
"""How far the estimate was carried by the wheels alone, per direction, and by how much it may be wrong there.

The walls that a scan meets hold the estimate along their normals. Along a bare corridor, or beside the one wall within
reach, there is a direction that no normal has: there nothing but the wheels tell how far the robot drove, and no scan
can contradict them. The covariance of that part of the estimate grows by that of the motion model with each step,

    C <- U (C + v I) U,        U: projection on the directions that are not held,  v: variance of the step by the model,

and is zero again in each direction that is held again. How far the wheels of this run err in counting the way is seen
where the way is held: r is the mean of the squared innovations along the heading in units of their variance, the motion
model itself counted as `MODEL_STEPS` steps. Those across the way say little of it: wheels slip along it. The estimate
may then be wrong by two standard deviations, 2 sqrt(r c), c the larger eigenvalue of C.

The wheels themselves may show more (`wheel_speed`): if their speed changes at once and comes back at once, in a
direction that is not held, the way in between is missing, unless the scans have shown that this robot drives so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

from slam.diagnosis.plain_parts import part_of, plain_pose
from slam.diagnosis.wheel_speed import WheelNews

MIN_HELD = 3.0
"""A direction is held if the walls met by so many of the compared beams have it as their normal."""
SURELY_HELD = 10.0
"""What wheels and scans agree on in a direction that so many beams hold is true."""
MODEL_STEPS = 20.0
"""What the motion model says of the wheels counts as so many steps of the run."""
LEFT_SIGMAS = 3.0
"""An estimate that leaves the wheels by more standard deviations than this was held by something."""
MAX_ERROR_M = 0.5
"""An estimate that may be wrong by more than this [m] is doubtful, one that lacks more of its way is lost: by so much
in a metre the motion of an estimate must be wrong for the outcome `lost`."""
HONEST_SHARE = 0.2
"""Wheels that changed their speed were right if the scans make up for less than this share of the missing way."""

Symmetric = tuple[float, float, float]
"""The elements xx, xy and yy of a symmetric matrix (2, 2): plain numbers, since each scan needs some."""
NONE, ALL = (0.0, 0.0, 0.0), (1.0, 0.0, 1.0)
"""The projections on no direction and on all."""


class Hold(NamedTuple):
    """What a scan and the wheels say of a step of the estimate, in the map's frame."""

    normals: Symmetric
    """Sum of n n^T over the compared beams that end at a wall of normal n."""
    innovation: tuple[float, float]
    """Position of the estimate less that which the wheels predict [m]."""
    variance: float
    """Variance of that by the motion model, where the odometry has not failed [m^2]."""
    heading: float
    """Direction in which the wheels count forward [rad]."""
    news: WheelNews
    """What the speed of the wheels says of the step."""


@dataclass(frozen=True, kw_only=True)
class UnheldStretch:
    """Consecutive scans that do not hold the estimate in one direction at least."""

    stamp: float
    """When it began [s]."""
    place: tuple[float, float, float]
    """Estimated pose of the robot then [m, m, rad]."""
    seconds: float = 0.0
    """How long it has lasted [s]."""
    metres: float = 0.0
    """How far the robot has driven since, by the estimate [m]."""
    variance: float = 0.0
    """Variance of the estimate in its worst direction, by the motion model [m^2]."""


@dataclass(frozen=True, kw_only=True)
class MissingWay:
    """A time in which the wheels had a speed that the robot can hardly have had, and nothing else held the estimate."""

    stamp: float
    """When it began [s]."""
    place: tuple[float, float, float]
    """Estimated pose of the robot then [m, m, rad]."""
    seconds: float
    """How long it lasted [s]."""
    metres: float
    """How much of the way is missing [m]."""


@dataclass(kw_only=True)
class SpeedChange:
    """A change of the wheels' speed that has not ended yet."""

    stamp: float
    """When it began [s]."""
    place: tuple[float, float, float]
    """Estimated pose of the robot then [m, m, rad]."""
    lacking: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """What the estimate lacks in the directions in which it was not held since, (2,) [m]."""
    missing: float = 0.0
    """Way that the wheels may not have counted [m]."""
    made_up: float = 0.0
    """How much farther the estimate went than the wheels [m]."""
    held: float = math.inf
    """Beams that held the estimate in the worst direction of the worst scan."""


class UnheldDirections:
    """Follows, scan by scan, in which directions an estimate is held."""

    def __init__(self) -> None:
        """Begin where everything is held."""
        self.still_missing = False
        """Whether the estimate has not been held in all directions since a way is missing."""
        self._last: tuple[float, tuple[float, float, float]] | None = None  # stamp and estimated pose at the last scan
        self._covariance = NONE  # by the motion model [m^2]
        self._present: UnheldStretch | None = None
        self._worst: UnheldStretch | None = None
        self._squares, self._count = 0.0, 0.0  # innovations in units of their standard deviation
        self._change: SpeedChange | None = None
        self._missing: MissingWay | None = None  # the longest
        self._honest = False  # whether the robot changed its speed at once where the scans saw it

    @property
    def rate(self) -> float:
        """Variance of the wheels of this run in units of that of the motion model."""
        return (MODEL_STEPS + self._squares) / (MODEL_STEPS + self._count)

    @property
    def missing(self) -> MissingWay | None:
        """The longest way that is missing; None = none is."""
        return None if self._honest else self._missing

    @property
    def worst(self) -> tuple[UnheldStretch, float] | None:
        """The stretch after which the estimate may be wrong the most, and by how much [m]; None = there was none."""
        return None if self._worst is None else (self._worst, 2.0 * math.sqrt(self.rate * self._worst.variance))

    def update(self, stamp: float, pose: tuple[float, float, float], hold: Hold) -> None:
        """Take in a step of the estimate, to a pose [m, m, rad] at a time [s]."""
        last, self._last = self._last or (stamp, pose), (stamp, pose)
        unheld, held = _unheld(hold.normals)
        self._learn(hold, unheld)
        if hold.news.stage != "steady":
            self._follow_change(last, stamp, hold, unheld, held)
        if unheld == NONE:
            self._covariance, self._present, self.still_missing = NONE, None, False
            return
        xx, xy, yy = self._covariance
        self._covariance = _projected(unheld, (xx + hold.variance, xy, yy + hold.variance))
        stretch = self._present or UnheldStretch(stamp=last[0], place=last[1])
        self._present = replace(
            stretch,
            seconds=stamp - stretch.stamp,
            metres=stretch.metres + math.hypot(pose[0] - last[1][0], pose[1] - last[1][1]),
            variance=_eigenvalues(self._covariance)[1],
        )
        if self._worst is None or self._present.variance > self._worst.variance:
            self._worst = self._present

    def _learn(self, hold: Hold, unheld: Symmetric) -> None:
        """Compare the innovation of a step along the heading with the motion model, as far as it is held there."""
        cos, sin = math.cos(hold.heading), math.sin(hold.heading)
        square = (cos * hold.innovation[0] + sin * hold.innovation[1]) ** 2 / hold.variance
        along = cos * cos * unheld[0] + 2.0 * cos * sin * unheld[1] + sin * sin * unheld[2]
        held = 1.0 if square > LEFT_SIGMAS**2 else 1.0 - along
        self._squares += held * square
        self._count += held

    def _follow_change(
        self,
        last: tuple[float, tuple[float, float, float]],
        stamp: float,
        hold: Hold,
        unheld: Symmetric,
        held: float,
    ) -> None:
        """Follow a change of the wheels' speed, from the scan before to the one at `stamp` [s]."""
        change = self._change or SpeedChange(stamp=last[0], place=last[1])
        cos, sin = math.cos(hold.heading), math.sin(hold.heading)
        x = change.lacking[0] + hold.news.missing * cos - hold.innovation[0]
        y = change.lacking[1] + hold.news.missing * sin - hold.innovation[1]
        self._change = change = replace(
            change,
            lacking=[unheld[0] * x + unheld[1] * y, unheld[1] * x + unheld[2] * y],
            missing=change.missing + hold.news.missing,
            made_up=change.made_up + cos * hold.innovation[0] + sin * hold.innovation[1],
            held=min(change.held, held),
        )
        if hold.news.stage == "changed":
            return
        self._change, lacks = None, math.hypot(*change.lacking)
        if hold.news.stage == "back" and lacks > MAX_ERROR_M:
            self.still_missing = True
            if self._missing is None or lacks > self._missing.metres:
                seconds = stamp - change.stamp
                self._missing = MissingWay(stamp=change.stamp, place=change.place, seconds=seconds, metres=lacks)
        elif change.held >= SURELY_HELD and abs(change.made_up) < HONEST_SHARE * abs(change.missing):
            self._honest = True

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        parts = {"present": self._present, "worst": self._worst, "change": self._change, "missing": self._missing}
        return {
            **{name: None if part is None else asdict(part) for name, part in parts.items()},
            "last": self._last,
            "covariance": self._covariance,
            "squares": self._squares,
            "count": self._count,
            "honest": self._honest,
            "still_missing": self.still_missing,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._present, self._worst = (part_of(UnheldStretch, state[name]) for name in ("present", "worst"))
        self._change, self._missing = part_of(SpeedChange, state["change"]), part_of(MissingWay, state["missing"])
        last = state["last"]
        self._last = None if last is None else (float(last[0]), plain_pose(last[1]))
        xx, xy, yy = state["covariance"]
        self._covariance = (float(xx), float(xy), float(yy))
        self._squares, self._count = float(state["squares"]), float(state["count"])
        self._honest, self.still_missing = bool(state["honest"]), bool(state["still_missing"])


def _eigenvalues(matrix: Symmetric) -> tuple[float, float]:
    """The smaller and the larger eigenvalue."""
    mean, radius = 0.5 * (matrix[0] + matrix[2]), math.hypot(0.5 * (matrix[0] - matrix[2]), matrix[1])
    return mean - radius, mean + radius


def _unheld(normals: Symmetric) -> tuple[Symmetric, float]:
    """Projection on the directions that too few beams hold, and how many hold the worst direction."""
    least, most = _eigenvalues(normals)
    if most < MIN_HELD:
        return ALL, least
    if least >= MIN_HELD:
        return NONE, least
    angle = 0.5 * math.atan2(2.0 * normals[1], normals[0] - normals[2])  # of the direction that is held
    cos, sin = math.cos(angle), math.sin(angle)
    return (sin * sin, -sin * cos, cos * cos), least


def _projected(unheld: Symmetric, covariance: Symmetric) -> Symmetric:
    """U C U for a projection U on one direction or on both."""
    if unheld == ALL:
        return covariance
    xx, xy, yy = unheld  # e e^T, so that U C U = (e^T C e) U
    variance = xx * covariance[0] + 2.0 * xy * covariance[1] + yy * covariance[2]
    return xx * variance, xy * variance, yy * variance
