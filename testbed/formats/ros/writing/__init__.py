# SPDX-License-Identifier: MIT
"""ROS bags, written: blocks of frames to messages and files."""
