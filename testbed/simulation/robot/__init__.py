# SPDX-License-Identifier: MIT
"""Lidar and wheel odometry of the robot, with their errors."""
