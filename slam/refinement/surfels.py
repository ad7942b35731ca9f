# SPDX-License-Identifier: MIT
"""Surfels: short pieces of wall, each with the side that it was seen from, found in the end points of all scans.

Where many end points lie, a line is fitted to those in a window, short ranges with more weight than long ones;
the two faces of a thin wall are told apart by where they were seen from. The best lines, at least `spacing` apart,
are the surfels (after Bosse and Zlot, ICRA 2009, who match such elements of several sweeps).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config.filter import RefineConfig
from slam.grid._tile_kernels import SIDE
from slam.grid._traversal_kernels import Rays
from slam.refinement._surfel_kernels import (
    Cells,
    Cloud,
    Lines,
    Noise,
    Placed,
    add_moments,
    choose,
    fit_lines,
    fit_normals,
    list_candidates,
    list_places,
    mark_cells,
    mark_tiles,
    place_cloud,
)


class Surfels(NamedTuple):
    """Pieces of wall, and what it takes to find that of an end point."""

    place: NDArray[np.float64]
    """A point on each [m], map frame, (surfels, 2)."""
    normal: NDArray[np.float64]
    """Unit normal towards where it was seen from, (surfels, 2)."""
    weight: NDArray[np.float64]
    """Sum of the weights of the end points [1/m^2] of the line that each was made of, (surfels,)."""
    lines: Lines
    """The lines through the end points about each cell, among which they were chosen."""
    first: NDArray[np.int64]
    """Surfels within reach of cell i are items[first[i] : first[i + 1]], (cells + 1,)."""
    items: NDArray[np.int32]
    """Numbers of surfels."""


def cloud_of(rays: Sequence[Rays], most: int) -> Cloud:
    """The hits of all scans; where there are more than `most`, each k-th one of all, which stands for k."""
    hits = [np.flatnonzero(ray.hit) for ray in rays]
    begins = np.concatenate([[0], np.cumsum([len(hit) for hit in hits])])
    each = max(-(-int(begins[-1]) // most), 1)
    kept = [hit[-begin % each :: each] for hit, begin in zip(hits, begins, strict=False)]
    ends = np.concatenate([ray.ends[hit] for ray, hit in zip(rays, kept, strict=True)])
    origins = np.concatenate([ray.origins[hit] for ray, hit in zip(rays, kept, strict=True)])
    first = np.concatenate([[0], np.cumsum([len(hit) for hit in kept])])
    return Cloud(ends, origins, np.hypot(*(ends - origins).T), first, float(each))


def noise_of(config: RefineConfig) -> Noise:
    """Spread of end points about a wall."""
    return Noise(config.hit_sigma**2, config.range_share**2)


def placed(cloud: Cloud, poses: se2.Pose, threads: Threads) -> Placed:
    """The cloud in the map's frame; poses (scans, 3)."""
    out = Placed(np.empty_like(cloud.ends), np.empty_like(cloud.ends))
    threads.run(place_cloud, len(poses), poses, cloud, out)
    return out


def cells_of(points: NDArray[np.float64], side: float) -> tuple[Cells, NDArray[np.int32]]:
    """The cells of `side` [m] in which points (n, 2) lie, and the cell of each point (n,)."""
    corner = points.min(axis=0) - side
    columns, rows = (np.ceil((points.max(axis=0) - corner) / (side * SIDE)).astype(np.int64) + 1).tolist()
    tiles = np.empty((rows, columns), np.int32)
    numbers = np.empty((mark_tiles(points, corner, side, tiles), SIDE * SIDE), np.int32)
    cell_of = np.empty(len(points), np.int32)
    places = np.empty((mark_cells(points, corner, side, tiles, numbers, cell_of), 2), np.int32)
    list_places(tiles, numbers, places)
    return Cells(tiles, numbers, places, corner, side), cell_of


def find_surfels(
    placed: Placed,
    cloud: Cloud,
    cells: Cells,
    cell_of: NDArray[np.int32],
    config: RefineConfig,
    reach: float,
    threads: Threads,
) -> Surfels:
    """The surfels of a cloud, with a list for each cell of those within `reach` [m]."""
    count, noise = len(cells.places), noise_of(config)
    radius = round(config.window / cells.side)
    normals, moments, counts = np.zeros((count, 2)), np.zeros((count, 2, 6)), np.zeros((count, 2), np.int32)
    add_moments(placed, cloud.ranges, noise, cells, cell_of, normals, moments, counts)  # all on side 0: no normals yet
    threads.run(fit_normals, count, cells, moments, radius, normals)
    moments[:], counts[:] = 0.0, 0
    add_moments(placed, cloud.ranges, noise, cells, cell_of, normals, moments, counts)
    lines = Lines(np.empty((count, 2)), np.empty((count, 2, 2)), np.empty((count, 2, 2)))
    threads.run(fit_lines, count, cells, moments, counts, normals, radius, config.flatness, lines)
    weight = lines.weight.ravel()
    order = np.argsort(-weight, kind="stable")[: np.count_nonzero(weight)]
    chosen = np.empty_like(order)
    chosen = chosen[: choose(order, cells, lines, config.spacing, radius, chosen)]
    place, normal = lines.place.reshape(-1, 2)[chosen], lines.normal.reshape(-1, 2)[chosen]
    return Surfels(place, normal, weight[chosen], lines, *list_candidates(place, cells, reach))
