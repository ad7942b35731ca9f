# SPDX-License-Identifier: MIT
"""ROS bags, read: messages to a log."""
