# SPDX-License-Identifier: MIT
"""Worlds in files: TOML, ROS maps, floor plans."""
