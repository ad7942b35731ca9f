# SPDX-License-Identifier: MIT
"""What does not change in a recording: colours, legends, the robot's shape, the true walls."""
