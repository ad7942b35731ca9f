# SPDX-License-Identifier: MIT
"""Maps, poses and paths as Rerun's archetypes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.views.rerun import drawing


def grid_map(grid: OccupancyGrid, z: float = 0.0, opacity: float = 1.0) -> rr.GridMap:
    """A map; its lower left corner lies at the grid's origin, raised by z [m]."""
    x, y, theta = grid.origin
    rows, cols = grid.probability.shape
    return rr.GridMap(
        data=drawing.cells_from_top(grid).tobytes(),
        format=rr.components.ImageFormat(width=cols, height=rows, color_model="L", channel_datatype="U8"),
        cell_size=grid.resolution,
        translation=(x, y, z),
        quaternion=rr.Quaternion(xyzw=drawing.quaternion(theta)),
        colormap=rr.components.Colormap.RvizMap,
        opacity=opacity,
    )


def pose_transform(pose: Pose) -> rr.Transform3D:
    """A pose (3,) of the plane."""
    return rr.Transform3D(
        translation=(pose[0], pose[1], 0.0), quaternion=rr.Quaternion(xyzw=drawing.quaternion(pose[2]))
    )


def line(path: Pose, z: float) -> rr.LineStrips3D:
    """The line through the positions of a path (n, 3) at height z [m]; its colour is set in `styles`."""
    return rr.LineStrips3D.from_fields(strips=strips([drawing.lifted(path, z)]))


def strips(lines: Sequence[NDArray[np.generic]]) -> Any:
    """Lines (n, 3) as the Arrow array that Rerun would make of them, which it takes as it is: its own conversion
    takes 30 us a line."""
    kind = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    flat = np.concatenate(lines).astype(np.float32, copy=False).reshape(-1)
    offsets = np.cumsum([0, *(len(points) for points in lines)], dtype=np.int32)
    return pa.ListArray.from_arrays(offsets, pa.FixedSizeListArray.from_arrays(flat, type=kind.value_type), type=kind)
