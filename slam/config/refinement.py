# SPDX-License-Identifier: MIT
"""Settings of the final pass."""

from __future__ import annotations

from dataclasses import dataclass, field

from slam.config._checks import require_at_least, require_at_most, require_positive
from slam.config.motion import FrameMotionConfig

MAX_ROUNDS, MAX_POINTS = 1000, 100_000_000
"""Largest number of rounds, and of points that the final pass may keep: 100 bytes each."""


@dataclass(frozen=True, kw_only=True)
class RefineConfig:
    """The final pass over a recording; never used inside the filter."""

    close_loops: bool = True
    """Close the loops that the filter left open first (`slam.loops`)."""
    rounds: int = 6
    """Number of rounds; each finds the walls again."""
    first_gate: float = 0.2
    """Gate of the first round [m]: end points this close to a wall, plus three standard deviations, belong to it."""
    gate_decay: float = 0.6
    """Factor by which the gate shrinks from round to round."""
    last_gate: float = 0.03
    """Smallest gate [m]: objects in front of a wall must not attract it."""
    cell: float = 0.05
    """Side of the cells into which end points are sorted [m]."""
    window: float = 0.15
    """Radius of the windows in which lines are fitted [m], rounded to cells."""
    flatness: float = 0.15
    """End points form a line if their variance across it is at most this share of their variance along it."""
    spacing: float = 0.25
    """Smallest distance between surfels along a wall [m]."""
    max_points: int = 3_000_000
    """Largest number of hits: with more, only every k-th hit is used for the poses; the map uses all."""
    motion: FrameMotionConfig = field(default_factory=FrameMotionConfig)
    """Motion model between neighbouring frames."""

    def __post_init__(self) -> None:
        require_at_least(self, 1, "rounds", "max_points")
        require_at_most(self, MAX_ROUNDS, "rounds")
        require_at_most(self, MAX_POINTS, "max_points")
        require_at_least(self, 0.0, "first_gate", "last_gate")
        require_positive(self, "gate_decay", "cell", "window", "flatness", "spacing")
        if not self.gate_decay <= 1.0:
            raise ValueError(f"RefineConfig.gate_decay must be at most 1, got {self.gate_decay}")
        if not self.window >= self.cell:
            raise ValueError(f"RefineConfig.window must be at least one cell of {self.cell} m, got {self.window} m")
