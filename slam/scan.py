# SPDX-License-Identifier: MIT
"""One lidar scan, as any driver or log gives it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_MOUNT = 100.0
"""Largest distance of a lidar from the robot's centre along an axis [m]."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Scan:
    """Ranges of one sweep of a 2D lidar: any number of beams, any angles, in any order.

    A reading counts as a hit if `range_min <= range < range_max`. Readings at or beyond `range_max`, `inf` included,
    are "no return"; NaN, zero, negative readings and those below `range_min` are invalid and carry no information.
    """

    ranges: NDArray[np.float64]
    """Measured distances [m], (beams,)."""
    angles: NDArray[np.float64]
    """Direction of each beam in the lidar's frame [rad], counter-clockwise, 0 = forward, (beams,)."""
    range_max: float
    """Readings of at least this range are no returns [m]."""
    range_min: float = 0.0
    """Readings below this range are invalid [m]."""
    stamp: float = 0.0
    """Time of the first beam [s]."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """`T_robot_lidar`: pose of the lidar on the robot [m, m, rad]."""
    time_offsets: NDArray[np.float64] | None = None
    """Time of each beam after `stamp` [s], (beams,); None = all beams at once, or unknown."""

    def __post_init__(self) -> None:
        for name in ("ranges", "angles"):
            if not isinstance(getattr(self, name), np.ndarray):
                raise TypeError(f"{name} must be a numpy array (beams,), got {type(getattr(self, name)).__name__}")
        if self.ranges.ndim != 1 or self.ranges.shape != self.angles.shape:
            raise ValueError(
                f"ranges and angles must be (beams,) alike, got shapes {self.ranges.shape} and {self.angles.shape}"
            )
        if self.time_offsets is not None and self.time_offsets.shape != self.ranges.shape:
            raise ValueError(
                f"time_offsets must be (beams,) = {self.ranges.shape}, got shape {self.time_offsets.shape}"
            )
        if not 0.0 <= self.range_min < self.range_max:  # also where one is NaN
            raise ValueError(f"expected 0 <= range_min < range_max, got {self.range_min} m and {self.range_max} m")
        if not np.all(np.isfinite(self.mount)):
            raise ValueError(f"mount must be finite, got {self.mount}")
        if not max(abs(self.mount[0]), abs(self.mount[1])) <= MAX_MOUNT:
            raise ValueError(f"mount must be within {MAX_MOUNT:g} m of the robot, got {self.mount}")

    def __repr__(self) -> str:
        """One line, for notebooks."""
        hits, none = int(self.hit.sum()), int(self.no_return.sum())
        return f"<Scan {self.stamp:.3f} s: {len(self.ranges)} beams, {hits} hits, {none} without return>"

    @property
    def hit(self) -> NDArray[np.bool_]:
        """Beams that hit something, (beams,)."""
        mask: NDArray[np.bool_] = (self.ranges >= self.range_min) & (self.ranges > 0.0) & (self.ranges < self.range_max)
        return mask

    @property
    def has_beam_times(self) -> bool:
        """Whether the beams were measured at times that are known to differ."""
        times = self.time_offsets
        return times is not None and times.size > 0 and bool(np.ptp(times) > 0.0)

    @property
    def no_return(self) -> NDArray[np.bool_]:
        """Beams that saw nothing up to `range_max`, (beams,)."""
        mask: NDArray[np.bool_] = self.ranges >= self.range_max
        return mask


def listed(scan: Scan | Sequence[Scan]) -> list[Scan]:
    """One scan, or those of several lidars, as a list.

    Raises:
        TypeError: something else came.
        ValueError: there is no scan.
    """
    scans = [scan] if isinstance(scan, Scan) else list(scan)
    if not scans:
        raise ValueError("expected at least one scan, got none")
    for each in scans:
        if not isinstance(each, Scan):
            raise TypeError(f"scan must be a slam.Scan, or several of them, got {type(scan).__name__}")
    return scans
