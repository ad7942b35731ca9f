# SPDX-License-Identifier: MIT
"""Find the cells of the true map that an ideal lidar sees from the true path: only these are scored."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from eval.map.lidar_view import LidarView
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, compose, inverse, wrap_angle

RAYS = 1080
"""Rays from each viewpoint, a third of a degree apart: closer than a cell of 5 cm up to 8.6 m away."""
_SECTOR = 0.1
"""Poses whose headings fall into one sector of this width count as one viewpoint [rad]."""
_BATCH = 64
"""Viewpoints whose rays are followed together."""


def observable_cells(
    truth: OccupancyGrid, robot_poses: ArrayLike, *, lidar: LidarView, spacing: float = 0.5
) -> NDArray[np.bool_]:
    """Return the cells seen from the true poses `T_world_robot` (n, 3), (rows, cols): free ones, walls that end rays.

    The poses are thinned out to one per square of `spacing` [m]; for a lidar that does not see all around, to one per
    square and tenth of a radian of heading. Rays are followed by sphere tracing (Hart, The Visual Computer 12, 1996)
    to the first cell that is not free; a free cell is in sight if it is nearer than the end of the ray that passes
    next to it. Traps: a pose that was thinned out may have seen a little farther around a corner; slits narrower
    than the spacing of the rays block the view.
    """
    at = lidar.lidar_poses(np.asarray(robot_poses, dtype=np.float64).reshape(-1, 3))
    at = compose(inverse(truth.origin), at)[_thinned(at, lidar, spacing)]
    points = at[:, :2] / truth.resolution
    rows, cols = truth.probability.shape
    inside = (points >= 0.0).all(axis=1) & (points < [cols, rows]).all(axis=1)
    on = np.flatnonzero(inside)
    on = on[truth.free[points[on, 1].astype(np.intp), points[on, 0].astype(np.intp)]]
    points, headings = points[on], at[on, 2]

    # The border of one occupied cell ends every ray.
    free = np.pad(truth.free, 1)
    wall_seen, unseen = np.zeros_like(free), free.copy()
    room = ndimage.distance_transform_edt(free)
    for start in range(0, len(points), _BATCH):
        viewpoints = points[start : start + _BATCH] + 1.0
        in_view = lidar.sees(_angles() - headings[start : start + _BATCH, None])
        lengths, ends = _trace(free, room, viewpoints, in_view, lidar.range_max / truth.resolution)
        wall_seen[ends[:, 1], ends[:, 0]] = True
        for viewpoint, length in zip(viewpoints, lengths, strict=True):
            _see(unseen, viewpoint, length)
    seen: NDArray[np.bool_] = (free & ~unseen) | (wall_seen & ~free)
    return seen[1:-1, 1:-1] & truth.known


def _thinned(poses: Pose, lidar: LidarView, spacing: float) -> NDArray[np.intp]:
    """Return the rows of the first pose in each square, and in each sector of headings where the heading matters."""
    keys = np.floor(poses[:, :2] / spacing)
    if not lidar.all_around:
        keys = np.column_stack([keys, np.floor(wrap_angle(poses[:, 2]) / _SECTOR)])
    rows: NDArray[np.intp] = np.sort(np.unique(keys.astype(np.int64), axis=0, return_index=True)[1])
    return rows


def _trace(
    free: NDArray[np.bool_],
    room: NDArray[np.float64],
    viewpoints: NDArray[np.float64],
    in_view: NDArray[np.bool_],
    reach: float,
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Follow the rays `in_view` (v, RAYS) from viewpoints (v, 2) [cells].

    `room` is the distance of each cell from one that is not free. Returns the lengths (v, RAYS), at most `reach`, 0
    for rays outside of the view, and the (col, row) (k, 2) of the cells that ended rays.
    """
    angles = _angles()
    way = np.tile(np.column_stack([np.cos(angles), np.sin(angles)]), (len(viewpoints), 1))
    origin = np.repeat(viewpoints, RAYS, axis=0)
    length = np.zeros(len(way))
    on, ends = np.flatnonzero(in_view), [np.zeros((0, 2), dtype=np.intp)]
    while len(on):
        cell = (origin[on] + length[on, None] * way[on]).astype(np.intp)
        clear = free[cell[:, 1], cell[:, 0]]
        ends.append(cell[~clear])
        # The distance between any two points of two cells is at least the distance of their centres less sqrt(2). The
        # smallest step is a quarter of a cell: a ray may cut a corner by that much.
        step = np.maximum(room[cell[:, 1], cell[:, 0]] - 1.4143, 0.25)
        on, step = on[clear], step[clear]
        length[on] += step
        on = on[length[on] < reach]
    return np.minimum(length, reach).reshape(-1, RAYS), np.concatenate(ends)


def _see(unseen: NDArray[np.bool_], viewpoint: NDArray[np.float64], length: NDArray[np.float64]) -> None:
    """Clear the cells of `unseen` in sight of one viewpoint [cells]; `length` (RAYS,) of its rays [cells]."""
    angles = _angles()
    x, y = viewpoint[0] + length * np.cos(angles), viewpoint[1] + length * np.sin(angles)
    low, high = max(int(y.min()), 0), int(y.max()) + 1
    rows, cols = np.divmod(np.flatnonzero(unseen[low:high]), unseen.shape[1])
    near = (cols >= int(x.min())) & (cols <= int(x.max()))
    rows, cols = rows[near] + low, cols[near]
    dx, dy = cols + 0.5 - viewpoint[0], rows + 0.5 - viewpoint[1]
    ray = ((np.arctan2(dy, dx) % (2.0 * np.pi)) * (RAYS / (2.0 * np.pi))).astype(np.intp) % RAYS
    in_sight = dx * dx + dy * dy <= length[ray] ** 2
    unseen[rows[in_sight], cols[in_sight]] = False


def _angles() -> NDArray[np.float64]:
    """Return the directions of the rays [rad], (RAYS,): the centres of equal sectors, beginning at 0."""
    return np.linspace(0.0, 2.0 * np.pi, RAYS, endpoint=False, dtype=np.float64) + np.pi / RAYS
