# SPDX-License-Identifier: MIT
"""Physics backends, which move the robot and cast the rays of its lidars."""
