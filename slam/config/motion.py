# SPDX-License-Identifier: MIT
"""Settings of the motion model; classic GMapping names in brackets."""

from __future__ import annotations

from dataclasses import dataclass

from slam.config._checks import require_at_least, require_positive


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """Standard deviations of the odometry's error per unit of motion (the filter's belief, not the robot's truth)."""

    translation_from_translation: float = 0.1
    """Error along the path per metre driven [m/m] (srr)."""
    translation_from_rotation: float = 0.05
    """Error of position per radian turned [m/rad] (srt)."""
    rotation_from_translation: float = 0.1
    """Error of heading per metre driven [rad/m] (str)."""
    rotation_from_rotation: float = 0.1
    """Error of heading per radian turned [rad/rad] (stt)."""
    floor_translation: float = 0.005
    """Error of position even without motion [m]."""
    floor_rotation: float = 0.003
    """Error of heading even without motion [rad]."""
    failure_share: float = 0.05
    """Share of the steps in which the odometry fails (slip, wrong sign): the tail of the motion model."""
    failure_along: float = 1.0
    """Error along the heading per metre driven in such a step [m/m]."""
    failure_limit: float = 0.4
    """Largest standard deviation of that error [m], because wheels slip and directions change on short stretches."""
    failure_rotation: float = 0.3
    """Additional error of heading per radian turned in such a step [rad/rad]."""
    jump_share: float = 0.001
    """Share of the steps of which the odometry says nothing (wheels that spin, a push, a restarted encoder)."""
    jump_along: float = 0.4
    """Error along the heading in such a step [m]."""
    jump_across: float = 0.3
    """Error across the heading in such a step [m]."""
    jump_rotation: float = 0.5
    """Error of heading in such a step [rad]."""

    def __post_init__(self) -> None:
        require_positive(self, "floor_translation", "floor_rotation")
        require_at_least(self, 0.0, "translation_from_translation", "translation_from_rotation")
        require_at_least(self, 0.0, "rotation_from_translation", "rotation_from_rotation")
        require_at_least(self, 0.0, "failure_along", "failure_limit", "failure_rotation")
        require_positive(self, "jump_along", "jump_across", "jump_rotation")
        if not 0.0 <= self.failure_share < 1.0:
            raise ValueError(f"MotionConfig.failure_share must be in [0, 1), got {self.failure_share}")
        if not 0.0 <= self.jump_share < 1.0 - self.failure_share:
            raise ValueError(
                f"MotionConfig.jump_share must be in [0, 1 - failure_share = {1.0 - self.failure_share:g}), "
                f"got {self.jump_share}"
            )


@dataclass(frozen=True, kw_only=True)
class FrameMotionConfig(MotionConfig):
    """The motion model between neighbouring frames, which are closer together than the updates of the filter.

    Its error is smaller at rest and larger per metre and radian, because errors of many short steps partly cancel. A
    class of its own, so that a changed setting leaves the defaults of the others as they are.
    """

    rotation_from_translation: float = 0.2
    """Error of heading per metre driven [rad/m] (str)."""
    rotation_from_rotation: float = 0.2
    """Error of heading per radian turned [rad/rad] (stt)."""
    floor_translation: float = 0.001
    """Error of position even without motion [m]."""
    floor_rotation: float = 0.002
    """Error of heading even without motion [rad]."""
