# SPDX-License-Identifier: MIT
"""What the layout of a run depends on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Self

from testbed.views.rerun.drawing import Extent


@dataclass(frozen=True, kw_only=True)
class Scenery:
    """What the blueprint of a run must know."""

    particles: int
    """Number of particles, at most: upper end of the axis of the effective sample size."""
    truth: bool
    """Whether there are errors to plot."""
    extent: Extent | None
    """What the views of the map show; None = not known yet, they follow the robot."""
    max_error_m: float | None = None
    """Largest position error of the estimate [m]; None = not known yet."""
    max_error_deg: float | None = None
    """Largest heading error of the estimate [deg]; None = not known yet."""
    max_odometry_error_m: float | None = None
    """Largest position error of the odometry or the estimate [m]; None = not known yet."""
    final_pass: bool = False
    """Whether there is a final pass to show."""

    def to_json(self) -> dict[str, Any]:
        """Convert to plain data, for another process."""
        return asdict(self)

    @classmethod
    def from_json(cls, plain: dict[str, Any]) -> Self:
        """Make a scenery from the plain data of `to_json`."""
        extent = plain["extent"]
        return cls(**plain | {"extent": None if extent is None else Extent(**extent)})
