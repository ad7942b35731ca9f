# SPDX-License-Identifier: MIT
"""Matching two local maps: every displacement and heading of a window is searched, the best is refined and judged.

The search is correlative (Olson, "Real-Time Correlative Scan Matching", ICRA 2009), by branch and bound over a coarse
copy of the map; Gauss-Newton on the distance field of the other's walls follows. How well two maps agree is counted in
both directions: walls of one that lie on walls of the other, against walls that lie where the other saw free space.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig
from slam.grid.wall_maps import maps_of_walls
from slam.loops._correlative_kernels import MAX_SCORE, pool_maxima, search
from slam.loops.local_maps import LocalMap
from slam.matching._scan_matching_kernels import match_particles
from slam.matching.likelihood import ScanAndPrior, make_beam_model
from slam.matching.scan_matching import MatchSettings, empty_matches
from slam.motion.odometry_model import MotionPrior

COARSE = 2
"""Side of a cell of the search in cells of the map."""
LEVELS = 5
"""Levels of branch and bound: the coarsest node stands for 16 x 16 displacements."""
MAX_POINTS = 300
"""Points of a map that are searched with, at most: walls of 30 m, one in 10 cm."""
SCORES = (MAX_SCORE, 1, -1)
"""Score of a point on a wall or next to it, two cells away, and in free space."""
SAME_PLACE, SAME_HEADING = 1.0, 0.2
"""A second optimum lies farther than this from the first [m, rad]."""
NEAR = 2
"""Walls of two maps agree up to this many cells of the map from each other: what bent maps and noise make of one."""
FACING_SIGMA = 1.5
"""Standard deviation of the window in which the side of a wall is looked for [cells]."""
MIN_COSINE = 0.3
"""Walls face the same way where the cosine between their directions is above this, and opposite ways below its
negative; corners and posts do neither."""
PRIOR_SIGMA = (0.5, 0.5, 0.1)
"""Standard deviation of the pose about the result of the search [m, m, rad] in the refinement; it decides nothing but
directions in which the walls say nothing."""


class SearchMap(NamedTuple):
    """A local map prepared for matching."""

    walls: NDArray[np.float64]
    """Centres of the wall cells, seen from the anchor [m], (n, 2)."""
    points: NDArray[np.float64]
    """Some of them, evenly chosen, at most `MAX_POINTS`, (k, 2)."""
    origin: se2.Pose
    """Pose of the corner of cell (0, 0), seen from the anchor, (3,)."""
    cell: float
    """Side of a cell of the map [m]."""
    facing: NDArray[np.float64]
    """Unit vectors from the walls towards where they were seen from, seen from the anchor, (n, 2)."""
    near: NDArray[np.bool_]
    """Cells at most `NEAR` cells from a wall, (rows, columns)."""
    nearest: NDArray[np.int64]
    """Number of the wall cell that is nearest to each cell, (rows, columns)."""
    free: NDArray[np.bool_]
    """Free cells that are not near a wall, (rows, columns)."""
    levels: NDArray[np.int8]
    """Scores of coarse cells and their maxima, see `pool_maxima`."""
    reach: float
    """Distance from the anchor within which three quarters of the walls lie [m]; 0 where there are none."""


class Agreement(NamedTuple):
    """How well two maps agree at a relative pose, counted in both directions."""

    overlap: int
    """Wall cells of one map that agree with the other, the smaller of both directions."""
    share: float
    """Share of these among the wall cells that agree or contradict."""


class MapMatch(NamedTuple):
    """The result of a search."""

    pose: se2.Pose
    """Pose of the second map's anchor, seen from the first's, (3,)."""
    rivalry: float
    """Score of the best other place in the window, as a share of the best score."""


def prepare(local: LocalMap, cell: float) -> SearchMap:
    """Prepare a local map with cells of `cell` [m]."""
    is_wall = local.states == 1
    distance, (y, x) = distance_transform_edt(~is_wall, return_indices=True)
    near = distance <= NEAR
    number = np.cumsum(is_wall).reshape(is_wall.shape) - 1  # walls are listed row by row
    coarse_cell = COARSE * cell
    _, chosen = np.unique(np.floor(local.walls / coarse_cell), axis=0, return_index=True)
    thinned = local.walls[np.sort(chosen)]
    scores = _scores(local.states)
    levels = np.zeros((LEVELS, *scores.shape), np.int8)
    pool_maxima(scores, levels)
    every_kth = thinned[:: max(1, -(-len(thinned) // MAX_POINTS))]
    free = (local.states == -1) & ~near
    facing = _facing(local)
    reach = float(np.percentile(np.hypot(*local.walls.T), 75)) if len(local.walls) else 0.0
    return SearchMap(local.walls, every_kth, local.origin, cell, facing, near, number[y, x], free, levels, reach)


def thinned(seen: SearchMap, count: int) -> SearchMap:
    """The map with every k-th of its walls, at most `count`."""
    k = max(1, -(-len(seen.walls) // count))
    return seen._replace(walls=seen.walls[::k], facing=seen.facing[::k])


def _facing(local: LocalMap) -> NDArray[np.float64]:
    """Unit vectors (n, 2) from the walls towards the free space next to them, seen from the anchor; 0 where none is."""
    free = (local.states == -1).astype(np.float64)
    towards = [gaussian_filter(free, FACING_SIGMA, order=order, mode="constant") for order in ((0, 1), (1, 0))]
    vectors = np.stack(towards, axis=-1)[local.states == 1]
    length = np.hypot(vectors[:, 0], vectors[:, 1])
    unit = vectors / np.maximum(length, 1e-9)[:, None]
    return se2.transform_points((0.0, 0.0, local.origin[2]), unit)


def _scores(states: NDArray[np.int8]) -> NDArray[np.int8]:
    """Scores (rows, columns) of coarse cells, from states (rows, columns) of the map's cells."""
    rows, columns = (-(-n // COARSE) for n in states.shape)
    padded = np.zeros((rows * COARSE, columns * COARSE), np.int8)
    padded[: states.shape[0], : states.shape[1]] = states
    blocks = padded.reshape(rows, COARSE, columns, COARSE).swapaxes(1, 2).reshape(rows, columns, COARSE**2)
    wall, free = (blocks == 1).any(axis=-1), 2 * (blocks == -1).sum(axis=-1) >= COARSE**2
    next_to, two_away = (binary_dilation(wall, np.ones((3, 3), np.bool_), iterations=n) for n in (1, 2))
    scores = np.zeros((rows, columns), np.int8)
    scores[free & ~two_away] = SCORES[2]
    scores[two_away] = SCORES[1]
    scores[next_to] = SCORES[0]
    return scores


def search_window(
    first: SearchMap, second: SearchMap, guess: se2.Pose, distance: float, heading: float
) -> MapMatch | None:
    """The best pose of the second map in a window about a guess (3,), of half widths [m] and [rad]; None where the
    maps nowhere overlap."""
    cell = COARSE * first.cell
    reach = max(float(np.percentile(np.hypot(*second.points.T), 75)), 1.0)
    step = cell / reach
    turns = step * np.arange(-np.ceil(heading / step), np.ceil(heading / step) + 1)
    x, y, theta = se2.between(first.origin, guess)
    points = np.stack([se2.transform_points((x, y, theta + turn), second.points) for turn in turns])
    cells, half = np.floor(points / cell).astype(np.int64), int(np.ceil(distance / cell))
    best, nowhere = np.zeros(3, np.int64), np.array([0, 0, 0, -1, -1])
    score = search(first.levels, cells, half, 0, nowhere, best)
    if score <= 0:
        return None
    other, here = np.zeros(3, np.int64), np.array([*best, round(SAME_PLACE / cell), round(SAME_HEADING / step)])
    rival = search(first.levels, cells, half, score // 2, here, other)
    found = (x + best[0] * cell, y + best[1] * cell, theta + turns[best[2]])
    return MapMatch(se2.compose(first.origin, found), float(rival / score))


def refine_pose(
    first: SearchMap, second: SearchMap, pose: se2.Pose, config: FilterConfig, threads: Threads
) -> tuple[se2.Pose, NDArray[np.float64]]:
    """The pose (3,) of the second map, from a start (3,) near it, and its covariance (3, 3) along the first's axes."""
    maps = maps_of_walls(first.walls, config.map, threads)
    sigma = np.array(PRIOR_SIGMA)
    wide = MotionPrior(np.tile(sigma**-2.0, (3, 1)), np.array([0.0, -np.inf, -np.inf]), np.array([1.0, 0.0, 0.0]))
    beams = make_beam_model(config.match, config.map)
    none = MatchSettings(config.match.iterations, np.empty((0, 3)), beams, second.points)
    out = empty_matches(1)
    match_particles(0, 1, maps.grids, pose[None], ScanAndPrior(second.walls, beams, wide), none, out)
    inverse = np.linalg.inv(np.tril(out.factor[0]))
    return out.optimum[0].copy(), inverse.T @ inverse


def agreement(first: SearchMap, second: SearchMap, pose: se2.Pose) -> Agreement:
    """How well two maps agree with the second at a pose (3,) seen from the first."""
    agree_a, contradict_a = count_walls(first, second, pose)
    agree_b, contradict_b = count_walls(second, first, se2.inverse(pose))
    agree, contradict = agree_a + agree_b, contradict_a + contradict_b
    return Agreement(min(agree_a, agree_b), agree / max(agree + contradict, 1))


def count_walls(seen: SearchMap, other: SearchMap, pose: se2.Pose) -> tuple[int, int]:
    """How many walls of another map, which lies at a pose (3,), agree with a map and how many contradict it.

    They agree near a wall that was seen from the same side. They contradict in free space, and near a wall that was
    seen from the other side: two faces of a thin wall are not the same wall.
    """
    there = se2.between(seen.origin, pose)
    cells = np.floor(se2.transform_points(there, other.walls) / seen.cell).astype(np.int64)
    rows, columns = seen.near.shape
    inside = (cells >= 0).all(axis=1) & (cells[:, 0] < columns) & (cells[:, 1] < rows)
    x, y = cells[inside].T
    facing = se2.transform_points((0.0, 0.0, pose[2]), other.facing[inside])
    cosine = np.einsum("wi,wi->w", facing, seen.facing[seen.nearest[y, x]])
    near = seen.near[y, x]
    agree, opposite = near & (cosine > MIN_COSINE), near & (cosine < -MIN_COSINE)
    return int(agree.sum()), int((seen.free[y, x] | opposite).sum())
