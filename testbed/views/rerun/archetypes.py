# SPDX-License-Identifier: MIT
"""Maps, poses and paths as Rerun's archetypes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.views.map_cells import grey_levels
from testbed.views.rerun import drawing
from testbed.views.rerun.layers.map_tiles import SQUARE, Index


def grid_map(grid: OccupancyGrid) -> rr.GridMap:
    """A whole map; its lower left corner lies at the grid's origin."""
    x, y, theta = grid.origin
    image = grey_levels(grid.probability)[::-1]
    return rr.GridMap(
        data=image.tobytes(),
        format=_image_format(*image.shape),
        cell_size=grid.resolution,
        translation=(x, y, 0.0),
        quaternion=rr.Quaternion(xyzw=drawing.quaternion(theta)),
        colormap=rr.components.Colormap.Grayscale,
    )


def square_frame(index: Index, cell: float) -> list[rr.DescribedComponentBatch]:
    """Everything but the image of a square of a map, whose cells measure `cell` [m]."""
    side = SQUARE * cell
    shared, translation = _frame_of_squares(cell)
    place = rr.components.Translation3DBatch([[index[0] * side, index[1] * side, 0.0]])
    return [*shared, rr.DescribedComponentBatch(place, translation)]


@cache
def _frame_of_squares(cell: float) -> tuple[list[rr.DescribedComponentBatch], rr.ComponentDescriptor]:
    """What all squares have in common, and how Rerun describes their places: making it anew takes 0.5 ms a square."""
    frame = rr.GridMap.from_fields(
        format=_image_format(SQUARE, SQUARE),
        cell_size=cell,
        translation=(0.0, 0.0, 0.0),
        colormap=rr.components.Colormap.Grayscale,
    ).as_component_batches()
    places = [batch for batch in frame if batch.component_descriptor().component == "GridMap:translation"]
    return [batch for batch in frame if batch not in places], places[0].component_descriptor()


def _image_format(rows: int, columns: int) -> rr.components.ImageFormat:
    return rr.components.ImageFormat(width=columns, height=rows, color_model="L", channel_datatype="U8")


def image_buffers(images: Sequence[NDArray[np.generic]]) -> Any:
    """Images as the Arrow array that Rerun would make of them, which it takes as it is."""
    kind = rr.components.ImageBufferBatch._ARROW_DATATYPE
    flat = np.concatenate([image.reshape(-1) for image in images])
    offsets = np.cumsum([0, *(image.size for image in images)], dtype=np.int32)
    return pa.ListArray.from_arrays(offsets, pa.array(flat), type=kind)


def pose_transform(pose: Pose) -> rr.Transform3D:
    """A pose (3,) of the plane."""
    return rr.Transform3D(
        translation=(pose[0], pose[1], 0.0), quaternion=rr.Quaternion(xyzw=drawing.quaternion(pose[2]))
    )


def strips(lines: Sequence[NDArray[Any]], z: float) -> Any:
    """Lines (n, 2) at height z [m] as the Arrow array that Rerun would make of them, which it takes as it is: its own
    conversion takes 30 us a line."""
    kind = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    flat = drawing.lifted(np.concatenate([np.zeros((0, 2)), *lines]), z).reshape(-1)
    offsets = np.cumsum([0, *(len(points) for points in lines)], dtype=np.int32)
    return pa.ListArray.from_arrays(offsets, pa.FixedSizeListArray.from_arrays(flat, type=kind.value_type), type=kind)


def straight_strips(ends: NDArray[np.float64], z: float) -> Any:
    """Straight lines (n, 2, 2) at height z [m], as `strips` gives lines."""
    kind = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    flat = drawing.lifted(ends.reshape(-1, 2), z).reshape(-1)
    offsets = np.arange(0, 2 * len(ends) + 1, 2, dtype=np.int32)
    return pa.ListArray.from_arrays(offsets, pa.FixedSizeListArray.from_arrays(flat, type=kind.value_type), type=kind)


def lines(paths: Sequence[NDArray[Any]], z: float) -> rr.LineStrips3D:
    """Lines through points or poses (n, 2 or 3) at height z [m], without a style."""
    return rr.LineStrips3D.from_fields(strips=strips([path[:, :2] for path in paths], z))
