# SPDX-License-Identifier: MIT
"""ROS 1 and ROS 2 bags in and out."""
