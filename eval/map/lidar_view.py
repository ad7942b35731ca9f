# SPDX-License-Identifier: MIT
"""What part of its surroundings a lidar sees; it decides which cells of the true map are scored."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.scan import Scan
from slam.se2 import Pose, compose, wrap_angle

_MIN_BLIND = math.radians(3.0)
"""Gaps between beams up to this angle [rad], or three usual gaps, are the spacing of the beams, not a blind sector."""
_WAITING = 1000
"""Scans whose directions are united at once."""


@dataclass(frozen=True, kw_only=True)
class LidarView:
    """Field of view, range and mount of a lidar; the default sees everything from the robot's origin."""

    first: float = -math.pi
    """Direction in which the field of view begins, in the lidar's frame [rad]; it opens counter-clockwise."""
    width: float = 2.0 * math.pi
    """Angle of the field of view [rad], up to a full turn."""
    range_max: float = math.inf
    """Largest distance that it measures [m]."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """`T_robot_lidar` [m, m, rad]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.width <= 2.0 * math.pi + 1e-9 or not self.range_max > 0.0:
            raise ValueError(
                f"a lidar's view takes a width in (0, 2 pi] and a range above 0, got {self.width} and {self.range_max}"
            )
        if not np.isfinite([self.first, *self.mount]).all():
            raise ValueError(f"a lidar's view takes finite angles and mount, got {self.first} and {self.mount}")

    @classmethod
    def of(cls, scans: Iterable[Scan]) -> Self:
        """Derive the view from the scans of one lidar: all directions outside of the widest gap, and the largest range.

        Raises ValueError where there is no beam at all.
        """
        first, angles, reach = None, np.empty(0), 0.0
        waiting: list[NDArray[np.float64]] = []
        for scan in scans:
            if not len(scan.angles):
                continue
            reach = max(reach, scan.range_max)
            if first is None or scan.angles is not waiting[-1]:  # most scans of a recording share their directions
                waiting.append(scan.angles)
            first = first or scan
            if len(waiting) > _WAITING:
                angles, waiting = _united(angles, waiting), waiting[-1:]
        if first is None:
            raise ValueError("a lidar's view takes at least one scan with a beam, got none")
        angles = _united(angles, waiting)
        if not len(angles):
            raise ValueError("a lidar's view takes at least one scan with a beam, got none with a direction")
        gaps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
        widest = int(np.argmax(gaps))
        blind = float(gaps[widest])
        full = blind <= max(_MIN_BLIND, 3.0 * float(np.median(gaps)))
        if full:
            return cls(range_max=reach, mount=first.mount)
        begin = float(angles[(widest + 1) % len(angles)])
        # A single direction still has some width.
        return cls(first=begin, width=max(2.0 * math.pi - blind, 1e-3), range_max=reach, mount=first.mount)

    @classmethod
    def from_metrics(cls, document: Mapping[str, Any]) -> Self:
        """Read the table that `metrics` wrote; raises ValueError for a damaged one."""
        try:
            reach = document["range_max_m"]
            x, y, theta = (float(value) for value in document["mount"])
            return cls(
                first=math.radians(document["first_deg"]),
                width=min(math.radians(document["field_of_view_deg"]), 2.0 * math.pi),
                range_max=math.inf if reach is None else float(reach),
                mount=(x, y, theta),
            )
        except (KeyError, TypeError) as error:
            raise ValueError(
                f"expected a lidar's first_deg, field_of_view_deg, range_max_m and mount: {error}"
            ) from None

    @property
    def metrics(self) -> dict[str, Any]:
        """The view as a table of `metrics.json`."""
        return {
            "first_deg": math.degrees(self.first),
            "field_of_view_deg": math.degrees(self.width),
            "range_max_m": None if math.isinf(self.range_max) else self.range_max,
            "mount": list(self.mount),
        }

    @property
    def all_around(self) -> bool:
        """Whether it sees in every direction."""
        return self.width >= 2.0 * math.pi - 1e-9

    def lidar_poses(self, robot_poses: ArrayLike) -> Pose:
        """Convert `T_world_robot` (n, 3) to `T_world_lidar` (n, 3)."""
        return compose(robot_poses, self.mount)

    def sees(self, directions: ArrayLike) -> NDArray[np.bool_]:
        """Return which directions in the lidar's frame [rad], any shape, lie in the field of view."""
        inside: NDArray[np.bool_] = (np.asarray(directions) - self.first) % (2.0 * np.pi) <= self.width
        return inside | self.all_around


def _united(directions: NDArray[np.float64], further: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the distinct ones of directions (n,) and of the finite further ones, rounded: to a microradian they are
    one."""
    added = np.concatenate(further)
    added = added[np.isfinite(added)]  # a beam without a direction carries no information (`slam.sensor.rays`)
    united: NDArray[np.float64] = np.unique(np.concatenate([directions, np.round(wrap_angle(added), 6)]))
    return united
