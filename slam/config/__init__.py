# SPDX-License-Identifier: MIT
"""Settings: one frozen dataclass for each part of the estimator, checked when it is made."""

from slam.config.filter import (
    AdaptConfig,
    FilterConfig,
    GateConfig,
    MapConfig,
    MatchConfig,
    ProposalConfig,
    ResampleConfig,
)
from slam.config.localization import LocalizationConfig
from slam.config.motion import FrameMotionConfig, MotionConfig
from slam.config.refinement import RefineConfig

__all__ = [
    "AdaptConfig",
    "FilterConfig",
    "FrameMotionConfig",
    "GateConfig",
    "LocalizationConfig",
    "MapConfig",
    "MatchConfig",
    "MotionConfig",
    "ProposalConfig",
    "RefineConfig",
    "ResampleConfig",
]
