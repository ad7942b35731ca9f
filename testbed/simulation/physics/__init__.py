# SPDX-License-Identifier: MIT
"""Backends: what moves the robot and what the lidar's rays hit."""
