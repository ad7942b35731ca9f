# SPDX-License-Identifier: MIT
"""The robot's shape in a recording: its footprint as a coloured outline, the same in each view, that hides no particle.

A shape of faces would hide the particles below it, and a view whose contents have named frames, as the parts of a URDF
have, stays at the world's origin instead of following the robot (seen with Rerun 0.41).
"""

from __future__ import annotations

import numpy as np
import rerun as rr

OUTLINE_Z = 0.045
"""Height of the outline [m]: above the paths, below the particles."""


def log_robot(rec: rr.RecordingStream, robot: str, radius: float, colour: tuple[int, int, int]) -> None:
    """Log the footprint once, a circle of a radius [m] with a line to the front: it moves with the entity `robot`."""
    angles = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(49, OUTLINE_Z)])
    front = np.array([[0.0, 0.0, OUTLINE_Z], [1.5 * radius, 0.0, OUTLINE_Z]])
    for name, line in (("outline", circle), ("heading", front)):
        shape = rr.LineStrips3D([line], radii=rr.Radius.ui_points(1.5), colors=colour)
        rec.log(f"{robot}/{name}", shape, static=True)
