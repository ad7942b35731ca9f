# SPDX-License-Identifier: MIT
"""Settings of the final pass."""

from __future__ import annotations

from dataclasses import dataclass, field

from slam.config._checks import require_at_least, require_positive
from slam.config.motion import FrameMotionConfig


@dataclass(frozen=True, kw_only=True)
class RefineConfig:
    """The final pass over a recording; never used inside the filter."""

    rounds: int = 6
    """How often the walls are found anew."""
    hit_sigma: float = 0.02
    """Spread of end points about a wall near by [m]; less than in the filter, whose map still grows."""
    range_share: float = 0.01
    """Spread that comes on top of it along the beam, as a share of the range."""
    first_gate: float = 0.2
    """In the first round end points up to this far from a wall, plus three standard deviations, belong to it [m]."""
    gate_decay: float = 0.6
    """The gate narrows by this factor from round to round ..."""
    last_gate: float = 0.03
    """... down to this: things that stand before a wall must not pull [m]."""
    cell: float = 0.05
    """Side of the cells into which end points are sorted [m]."""
    window: float = 0.15
    """Radius of the windows in which lines are fitted [m], rounded to cells."""
    flatness: float = 0.15
    """End points form a line where their variance across it is at most this share of that along it."""
    spacing: float = 0.25
    """Distance of the surfels along a wall, at least [m]."""
    max_points: int = 3_000_000
    """With more hits than this every k-th one is used for the poses; the map takes all."""
    motion: FrameMotionConfig = field(default_factory=FrameMotionConfig)
    """Motion model between neighbouring frames."""

    def __post_init__(self) -> None:
        require_at_least(self, 1, "rounds", "max_points")
        require_at_least(self, 0.0, "range_share", "first_gate", "last_gate")
        require_positive(self, "hit_sigma", "gate_decay", "cell", "window", "flatness", "spacing")
        if not self.gate_decay <= 1.0:
            raise ValueError(f"RefineConfig.gate_decay must be at most 1, got {self.gate_decay}")
        if not self.window >= self.cell:
            raise ValueError(f"RefineConfig.window must be at least one cell of {self.cell} m, got {self.window} m")
