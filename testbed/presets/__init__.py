# SPDX-License-Identifier: MIT
"""Parameters of real robots and lidars in TOML files, each number with its source."""

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
