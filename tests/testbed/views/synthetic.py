# SPDX-License-Identifier: MIT
"""A small real run for the views: the filter maps a room without symmetry, from exact ranges and slipping wheels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from slam import se2
from slam.config import FilterConfig, MatchConfig, ResampleConfig
from slam.gmapping import GMapping
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from testbed.estimation.snapshot import take_snapshot
from testbed.frame import Frame
from testbed.views import Scene, Snapshot

WIDTH, HEIGHT = 8.0, 6.0
BOX = (5.5, 3.5, 7.0, 5.0)
"""A box in the upper right part of the room: a mirrored picture has it elsewhere."""
PERIOD = 0.1
BEAMS = 180


def walls() -> np.ndarray:
    """Segments (n, 4) of the room, its lower left corner at the origin, and of the box."""
    segments = []
    for x0, y0, x1, y1 in ((0.0, 0.0, WIDTH, HEIGHT), BOX):
        segments += [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]
    return np.array(segments)


def true_map(cell: float = 0.05) -> OccupancyGrid:
    """The room as a grid whose outer cells are wall."""
    rows, cols = round(HEIGHT / cell) + 2, round(WIDTH / cell) + 2
    probability = np.zeros((rows, cols), np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 1.0
    left, low, right, high = (round(edge / cell) + 1 for edge in BOX)
    probability[low:high, left:right] = 1.0
    return OccupancyGrid(probability=probability, resolution=cell, origin=(-cell, -cell, 0.0))


def truth_at(stamp: float) -> np.ndarray:
    """Pose on an ellipse about the room's middle, 24 s a round."""
    phase = 2.0 * np.pi * stamp / 24.0
    dx, dy = -2.0 * np.sin(phase), 1.5 * np.cos(phase)
    return np.array([3.5 + 2.0 * np.cos(phase), 2.5 + 1.5 * np.sin(phase), np.arctan2(dy, dx)])


def scan_at(pose: np.ndarray, stamp: float, beams: int = BEAMS) -> Scan:
    """Exact ranges to the walls from a pose (3,)."""
    angles = np.linspace(-np.pi, np.pi, beams, endpoint=False)
    direction = np.stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)], axis=-1)[:, None]
    start, along = walls()[:, :2], walls()[:, 2:] - walls()[:, :2]
    away = start - pose[:2]
    cross = direction[..., 0] * along[:, 1] - direction[..., 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0]) / cross
        share = (away[:, 0] * direction[..., 1] - away[:, 1] * direction[..., 0]) / cross
    distance = np.where((distance > 0.0) & (share >= 0.0) & (share <= 1.0), distance, np.inf)
    return Scan(ranges=distance.min(axis=1), angles=angles, range_max=20.0, stamp=stamp)


def settings(particles: int) -> FilterConfig:
    """Weights as sharp as the paper has them: now and then the particles are resampled, whatever the defaults are.

    Beams count in full, with a standard deviation that makes up for it, so that poses are drawn independently: that
    moves the reported pose where another particle becomes the best.
    """
    return FilterConfig(
        particles=particles,
        match=MatchConfig(hit_sigma=0.05 / 0.1**0.5, beam_weight=1.0, weight_share=1.0),
        resample=ResampleConfig(when="ess", threshold=0.5),
    )


def snapshots(
    seconds: float, particles: int = 30, seed: int = 0, period: float = PERIOD, reach: float = np.inf
) -> Iterator[Snapshot]:
    """What a run of so many seconds shows, one snapshot per scan, of a lidar that sees walls up to `reach` [m]."""
    rng = np.random.default_rng(seed)
    mapper = GMapping(settings(particles), seed=seed)
    odometry, previous = np.array([1.0, -2.0, 0.5]), truth_at(0.0)
    for k in range(round(seconds / period) + 1):
        stamp = k * period
        truth = truth_at(stamp)
        slip = rng.normal((0.001, 0.0, 0.002), (0.002, 0.001, 0.002))
        odometry = se2.compose(odometry, se2.between(previous, truth) + (slip if k else 0.0))
        previous = truth
        scan = scan_at(truth, stamp)
        scan = replace(scan, ranges=np.where(scan.ranges < reach, scan.ranges, np.inf))
        step = mapper.process(odometry, scan)
        yield take_snapshot(Frame(stamp=stamp, odometry=odometry, scan=scan, truth=truth), step, mapper)


def scene(particles: int = 30) -> Scene:
    """The scene that the snapshots belong to."""
    return Scene(
        title="synthetic room",
        settings="# Settings\n\n| name | value |\n|---|---|\n| particles | 30 |\n",
        particles=particles,
        true_map=true_map(),
        robot_radius=0.2,
    )
