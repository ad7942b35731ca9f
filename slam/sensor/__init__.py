# SPDX-License-Identifier: MIT
"""Scans as rays in the robot's frame, with the robot's motion during the scan undone."""
