# SPDX-License-Identifier: MIT
"""Where the lidar of a run sits: the group `mount` of `metrics.json` (docs/metrics.md), and a note if that is wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from slam.se2 import Pose
from testbed.frame import Frame
from testbed.run.mount_error import MountError, find_mount_error

MAX_SIGMA = 0.1
"""A place that is known less well is not stated [m]: the robot has hardly turned."""


def find_mount(frames: Sequence[Frame], odometry: Pose, path: Pose) -> MountError | None:
    """Estimate how far the lidar sits from where the frames say; None for several lidars, and for short drives.

    odometry, path: `T_odom_robot` and the final `T_map_robot` at every frame, (frames, 3)
    """
    seen = [(row, frame.lidar, frame.scan.mount) for row, frame in enumerate(frames) if frame.scan is not None]
    if len({(lidar, mount) for _, lidar, mount in seen}) != 1:
        return None
    rows = [row for row, _, _ in seen]
    return find_mount_error(odometry[rows], path[rows])


def mount_metrics(error: MountError) -> dict[str, Any]:
    """Return the group `mount`; a number whose deviation is above `MAX_SIGMA` is None."""
    x, y, angle = error.offset.tolist()
    x_sigma, y_sigma, angle_sigma = error.deviations.tolist()
    return {
        "x_m": x if x_sigma <= MAX_SIGMA else None,
        "x_sigma_m": x_sigma,
        "y_m": y if y_sigma <= MAX_SIGMA else None,
        "y_sigma_m": y_sigma,
        "angle_deg": math.degrees(angle),
        "angle_sigma_deg": math.degrees(angle_sigma),
        "is_off": any(error.significant),
        "odometry_scale": error.scale,
        "odometry_scale_sigma": error.scale_deviation,
    }


def mount_notes(error: MountError) -> list[str]:
    """Return a sentence where the mount is surely wrong, with the option that takes it back; else none."""
    if not any(error.significant):
        return []
    x, y, angle = (
        value if wrong else 0.0 for value, wrong in zip(error.offset.tolist(), error.significant, strict=True)
    )
    option = f"--mount-correction {x:.3f},{y:.3f},{math.degrees(angle):.2f}"
    return [f"mount: the lidar is {error.in_words()} than the recording says; {option} takes it back"]
