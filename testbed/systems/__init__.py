# SPDX-License-Identifier: MIT
"""SLAM systems of everyone, run on the same frames and scored by the same measures (docs/systems.md).

`protocol` says what a system is, `finding` finds one by name, `feeding` gives it the frames of a recording and checks
what comes back, `check` tries it on a short drive. Each system that comes with the package is a file.
"""

from testbed.systems.protocol import Lidar, System

__all__ = ["Lidar", "System"]
