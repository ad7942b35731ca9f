# SPDX-License-Identifier: MIT
"""Real robots and lidars as numbers, each with its source, in TOML files."""

from testbed.presets.files import PresetError, filter_settings, filters, lidars, load_lidar, load_robot, robots
from testbed.presets.models import LidarPreset, Mount, RobotPreset

__all__ = [
    "LidarPreset",
    "Mount",
    "PresetError",
    "RobotPreset",
    "filter_settings",
    "filters",
    "lidars",
    "load_lidar",
    "load_robot",
    "robots",
]
