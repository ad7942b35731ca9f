# SPDX-License-Identifier: MIT
"""A lidar that sits elsewhere than its recording says, put right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from slam import se2
from slam.scan import MAX_MOUNT
from slam.se2 import Pose
from testbed.formats import Log


def parse_mount_correction(text: str) -> Pose:
    """Return the x, y [m] and angle [rad] (3,) of a text X,Y,DEG; ValueError for anything else."""
    try:
        x, y, degrees = map(float, text.split(","))
    except ValueError:
        x = y = degrees = math.nan
    if not (abs(x) <= MAX_MOUNT and abs(y) <= MAX_MOUNT and abs(degrees) <= 360.0):
        raise ValueError(
            f"--mount-correction {text}: expected X,Y,DEG in metres (up to {MAX_MOUNT:g}) and degrees, such as "
            "0.05,0,-1.5"
        )
    return np.array([x, y, math.radians(degrees)])


def with_mount_correction(log: Log, correction: Pose) -> Log:
    """Return a log whose lidars sit at `correction` (3,), in the robot's frame, composed with what it says."""
    x, y, angle = correction.tolist()
    note = f"lidar {x:+g} m along x, {y:+g} m along y, turned by {math.degrees(angle):+g} deg (as given)"
    table = replace(log.table, mounts=se2.compose(correction, log.table.mounts))
    return replace(log, table=table, notes=(*log.notes, note))
