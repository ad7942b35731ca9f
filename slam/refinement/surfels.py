# SPDX-License-Identifier: MIT
"""Surfels: short pieces of wall, each with the side that it was seen from, found in the end points of all scans.

Where many end points lie, a line is fitted to those in a window, short ranges with more weight than long ones; the two
faces of a thin wall are distinguished by the side that they were seen from. The best lines, at least `spacing` apart,
are the surfels (after Bosse and Zlot, ICRA 2009, who match such elements of several sweeps).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import RefineConfig
from slam.grid._tile_kernels import SIDE
from slam.refinement._cell_index_kernels import list_candidates, list_coordinates, mark_cells, mark_tiles
from slam.refinement._line_fit_kernels import add_moments, choose, fit_lines, fit_normals, place_cloud
from slam.refinement.noise import Noise
from slam.sensor.rays import Rays

MIN_SUPPORT = 0.005
"""A line needs at least this share of the end points that the median line has. Stray readings before a wall lie in a
line by chance, the more often the longer the recording; each such line would tie the scans that made it to each other.
It is far below what a wall has that few scans have seen."""


class Cloud(NamedTuple):
    """End points of all scans, those of scan i from first[i] to first[i + 1]."""

    ends: NDArray[np.float64]
    """End points in the robot's frame [m], (n, 2)."""
    origins: NDArray[np.float64]
    """Start points of their beams in the robot's frame [m], (n, 2)."""
    ranges: NDArray[np.float64]
    """Lengths of the beams [m], (n,)."""
    first: NDArray[np.int64]
    """(scans + 1,)."""
    each: float
    """How many hits each end point stands for."""


class PlacedCloud(NamedTuple):
    """The cloud in the map's frame."""

    points: NDArray[np.float64]
    """End points [m], (n, 2)."""
    view_directions: NDArray[np.float64]
    """Unit vectors from the end points to where they were seen from, (n, 2)."""


class Cells(NamedTuple):
    """The cells in which end points lie."""

    tiles: NDArray[np.int32]
    """Number of the tile at (row, column) of tiles, (rows, columns); -1 = none."""
    indices: NDArray[np.int32]
    """Index of each cell of the tiles, (tiles, SIDE * SIDE); -1 = no end point there."""
    coordinates: NDArray[np.int32]
    """Column and row of each cell, (cells, 2)."""
    corner: NDArray[np.float64]
    """Position of the corner of cell (0, 0) [m], (2,)."""
    side: float
    """Side of a cell [m]."""


class Lines(NamedTuple):
    """Lines through the end points around each cell: those seen from one side (0) and those seen from the other (1)."""

    weight: NDArray[np.float64]
    """Sum of the weights, (cells, 2); 0 where the end points form no line."""
    point: NDArray[np.float64]
    """The point of the line that is nearest to the cell's centre [m], (cells, 2, 2)."""
    normal: NDArray[np.float64]
    """Unit normal towards where the end points were seen from, (cells, 2, 2)."""


class Surfels(NamedTuple):
    """Pieces of wall, and an index that finds the one of an end point."""

    point: NDArray[np.float64]
    """A point on each [m], map frame, (surfels, 2)."""
    normal: NDArray[np.float64]
    """Unit normal towards where it was seen from, (surfels, 2)."""
    weight: NDArray[np.float64]
    """Sum of the weights of the end points on the line that each was made from [1/m^2], (surfels,)."""
    lines: Lines
    """Lines through the end points around each cell, among which the surfels were chosen."""
    first: NDArray[np.int64]
    """Surfels within reach of cell i are items[first[i] : first[i + 1]], (cells + 1,)."""
    items: NDArray[np.int32]
    """Numbers of surfels."""


def make_cloud(rays: Collection[Rays], max_points: int) -> Cloud:
    """The hits of all scans. With more than `max_points` hits, every k-th one is kept and gets weight k.

    The scans are gone through twice, one at a time: those of a long recording may be made only when they are asked for.
    """
    hits = np.array([np.count_nonzero(ray.hit) for ray in rays])
    begins = np.cumsum(hits) - hits
    each = max(-(-int(hits.sum()) // max_points), 1)
    skipped = -begins % each
    first = np.concatenate([[0], np.cumsum(np.maximum(-(-(hits - skipped) // each), 0))])
    ends, origins = np.empty((first[-1], 2)), np.empty((first[-1], 2))
    for ray, begin, end, skip in zip(rays, first[:-1], first[1:], skipped, strict=True):
        kept = np.flatnonzero(ray.hit)[skip::each]
        ends[begin:end], origins[begin:end] = ray.ends[kept], ray.origins[kept]
    return Cloud(ends, origins, np.hypot(*(ends - origins).T), first, float(each))


def transform_cloud(cloud: Cloud, poses: se2.Pose, threads: Threads) -> PlacedCloud:
    """The cloud in the map's frame, its scans at poses (scans, 3)."""
    out = PlacedCloud(np.empty_like(cloud.ends), np.empty_like(cloud.ends))
    threads.run(place_cloud, len(poses), poses, cloud, out)
    return out


def make_cells(points: NDArray[np.float64], side: float) -> tuple[Cells, NDArray[np.int32]]:
    """The cells of `side` [m] in which points (n, 2) lie, and the cell of each point (n,)."""
    corner = points.min(axis=0) - side
    columns, rows = (np.ceil((points.max(axis=0) - corner) / (side * SIDE)).astype(np.int64) + 1).tolist()
    tiles = np.empty((rows, columns), np.int32)
    indices = np.empty((mark_tiles(points, corner, side, tiles), SIDE * SIDE), np.int32)
    cell_of = np.empty(len(points), np.int32)
    coordinates = np.empty((mark_cells(points, corner, side, tiles, indices, cell_of), 2), np.int32)
    list_coordinates(tiles, indices, coordinates)
    return Cells(tiles, indices, coordinates, corner, side), cell_of


def find_surfels(
    placed: PlacedCloud,
    cloud: Cloud,
    cells: Cells,
    cell_of: NDArray[np.int32],
    config: RefineConfig,
    noises: tuple[Noise, Noise],
    reach: float,
    threads: Threads,
) -> Surfels:
    """The surfels of a cloud, with a list for each cell of those within `reach` [m].

    noises: with which end points count in lines, and as it was estimated, which tells lines from what is not straight
    """
    count = len(cells.coordinates)
    radius = round(config.window / cells.side)
    normals, moments, counts = np.zeros((count, 2)), np.zeros((count, 2, 7)), np.zeros((count, 2), np.int32)
    seen = placed, cloud.ranges, *noises, cells, cell_of
    add_moments(*seen, normals, moments, counts)  # without normals yet, all are on side 0
    threads.run(fit_normals, count, cells, moments, radius, normals)
    moments[:], counts[:] = 0.0, 0
    add_moments(*seen, normals, moments, counts)
    lines = Lines(np.empty((count, 2)), np.empty((count, 2, 2)), np.empty((count, 2, 2)))
    support = np.zeros((count, 2), np.int32)
    threads.run(fit_lines, count, cells, moments, counts, normals, radius, config.flatness, lines, support)
    if (made := support[support > 0]).size:
        lines.weight[support < MIN_SUPPORT * np.median(made)] = 0.0
    weight = lines.weight.ravel()
    order = np.argsort(-weight, kind="stable")[: np.count_nonzero(weight)]
    chosen = np.empty_like(order)
    chosen = chosen[: choose(order, cells, lines, config.spacing, radius, chosen)]
    point, normal = lines.point.reshape(-1, 2)[chosen], lines.normal.reshape(-1, 2)[chosen]
    return Surfels(point, normal, weight[chosen], lines, *list_candidates(point, cells, reach))
