# SPDX-License-Identifier: MIT
"""The scan intake: checks odometry and scans, applies the update gates, and turns the used scans into rays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.config import FilterConfig, GateConfig
from slam.motion.continuous_odometry import ContinuousOdometry
from slam.scan import Scan, listed
from slam.sensor.rays import BeamCounts, Rays, count_beams, make_rays


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenScan:
    """One moment's scans as a step of the filter needs them."""

    odometry: se2.Pose
    """`T_odom_robot` at the first beam, joined where the odometry started again, (3,)."""
    stamp: float
    """Time of the first beam of the first scan [s]."""
    motion: se2.Pose
    """Displacement since the last scan that was used, seen from the robot there, (3,)."""
    first: bool
    """Whether no scan was used before."""
    counts: BeamCounts
    """Readings by kind."""
    rays: Rays | None
    """The readings in the robot's frame; None where the filter does not use the scan."""
    jumped: bool
    """Whether the odometry has jumped since the scan before, as where it starts again."""

    @property
    def hits(self) -> NDArray[np.float64]:
        """End points of the hits in the robot's frame [m], (K, 2)."""
        assert self.rays is not None
        return np.ascontiguousarray(self.rays.ends[self.rays.hit])

    @property
    def distance(self) -> float:
        """Length of the displacement [m]."""
        return float(np.hypot(self.motion[0], self.motion[1]))


class ScanIntake:
    """Decides which scans a filter uses; `take` looks at a scan, `accept` notes that the filter has used it."""

    def __init__(self, config: FilterConfig, *, first_needs_hits: bool) -> None:
        """first_needs_hits: whether the first used scan must have hit something, as every later one must."""
        self.scans = 0
        """Number of scans so far, used or not."""
        self.update_scans: list[int] = []
        """Numbers of the used scans."""
        self._config = config
        self._first_needs_hits = first_needs_hits
        self._track = ContinuousOdometry()
        self._odometry: se2.Pose | None = None  # joined, at the last scan that was used
        self._stamp = 0.0

    def take(
        self,
        odometry: ArrayLike,
        scan: Scan | Sequence[Scan],
        twist: ArrayLike | None,
        surprises: Callable[[se2.Pose, NDArray[np.float64]], bool] | None = None,
    ) -> TakenScan:
        """Check one moment's odometry (3,) and scans and decide whether the filter uses them.

        surprises: whether a scan below the gates is used all the same, from the displacement (3,) since the last used
        one and the hits (K, 2) [m]; None = never

        Raises:
            TypeError: `scan` is neither a `Scan` nor several of them.
            ValueError: the odometry or the twist is not three finite numbers.
        """
        given = checked_odometry(odometry, twist)
        scans = listed(scan)
        jumps = self._track.jumps
        now = self._track.update(scans[0].stamp, given)
        counts = count_beams(scans)
        self.scans += 1
        first = self._odometry is None
        motion = np.zeros(3) if self._odometry is None else se2.between(self._odometry, now)
        opens = first or gate_opens(self._config.gate, motion, scans[0].stamp - self._stamp)
        rays = None
        if opens or surprises is not None:
            rays = make_rays(
                scans,
                usable_range=self._config.map.usable_range,
                free_range=self._config.map.free_range,
                twist=twist if self._config.deskew else None,
            )
            if not rays.hit.any() and (self._first_needs_hits or not first):
                rays = None  # a scan that hit nothing carries no information about the pose
            elif not opens and surprises is not None and not surprises(motion, rays.ends[rays.hit]):
                rays = None
        return TakenScan(
            odometry=now,
            stamp=scans[0].stamp,
            motion=motion,
            first=first,
            counts=counts,
            rays=rays,
            jumped=self._track.jumps > jumps,
        )

    def accept(self, taken: TakenScan) -> None:
        """Note that the filter has used a scan: later displacements count from it."""
        self._odometry, self._stamp = taken.odometry, taken.stamp
        self.update_scans.append(self.scans - 1)

    def state(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Everything remembered: named arrays, and plain values fit for JSON."""
        arrays = {
            "odometry": np.empty(0) if self._odometry is None else self._odometry.copy(),
            "update_scans": np.array(self.update_scans, dtype=np.int64),
        }
        return arrays, {"stamp": self._stamp, "scans": self.scans, "track": self._track.state()}

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._odometry = np.array(arrays["odometry"]) if arrays["odometry"].size else None
        self.update_scans = arrays["update_scans"].tolist()
        self._stamp, self.scans = values["stamp"], values["scans"]
        self._track.restore(values["track"])


def checked_odometry(odometry: ArrayLike, twist: ArrayLike | None) -> se2.Pose:
    """The odometry (3,) as an array; ValueError where it or the twist (3,) is not three finite numbers."""
    now = np.asarray(odometry, dtype=np.float64)
    if twist is not None and not np.all(np.isfinite(twist)):
        raise ValueError(f"twist must be three finite numbers (vx, vy, omega), got {twist}")
    if now.shape != (3,) or not np.all(np.isfinite(now)):
        raise ValueError(f"odometry must be three finite numbers (x, y, theta), got {now.tolist()}")
    return now


def gate_opens(gate: GateConfig, motion: se2.Pose, seconds: float) -> bool:
    """Whether a scan is used after a displacement `motion` (3,) [m, m, rad] and a time since the last used one."""
    return bool(
        np.hypot(motion[0], motion[1]) >= gate.distance
        or abs(motion[2]) >= gate.angle
        or (gate.seconds > 0.0 and seconds >= gate.seconds)
    )
