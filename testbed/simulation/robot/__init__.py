# SPDX-License-Identifier: MIT
"""The robot's lidar and wheel odometry, with their errors."""
