# SPDX-License-Identifier: MIT
"""What the systems of a comparison made of one drive, as the layers of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import ImageColor

from eval.files.run_reader import read_run
from eval.report.comparison_plots import Aligned, aligned_runs
from slam import se2
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.systems.feeding import rows_of
from testbed.systems.particles import KeptParticles
from testbed.views import SystemLayer


def layers_of(
    directories: Sequence[Path], frames: Sequence[Frame], particles: Mapping[str, KeptParticles]
) -> list[SystemLayer]:
    """Return the layers of the run directories that hold a path, in the colours and the frame of the comparison page.

    directories: of runs on these frames, named after the systems;  particles: while driving, by the same names
    """
    runs = [(directory.name, read_run(directory)) for directory in directories]
    stamps = np.array([frame.stamp for frame in frames if frame.scan is not None])
    found = (_layer(path, stamps, particles.get(path.name, KeptParticles())) for path in aligned_runs(runs))
    return [layer for layer in found if layer is not None]


def _layer(path: Aligned, stamps: np.ndarray, particles: KeptParticles) -> SystemLayer | None:
    """stamps: of all scans, (scans,) [s]"""
    estimate = path.run.estimate
    assert estimate is not None
    rows = rows_of(estimate.stamps, stamps)
    if rows is None:
        return None
    errors = None
    if path.errors is not None:
        of_scan = np.full(len(stamps), np.nan)
        judged = rows_of(path.stamps, stamps)
        assert judged is not None  # the poses that are judged are some of those above
        of_scan[judged] = path.errors.translation_errors
        errors = of_scan[rows]
    grid = path.run.grid
    return SystemLayer(
        name=path.name,
        colour=ImageColor.getrgb(path.colour)[:3],
        rows=rows,
        poses=se2.compose(path.T_frame_estimate, estimate.poses),
        errors=errors,
        grid=None if grid is None or not grid.known.any() else _placed(grid, path.T_frame_estimate),
        particles={
            scan: (se2.compose(path.T_frame_estimate, poses), weights)
            for scan, (poses, weights) in particles.by_scan.items()
        },
    )


def _placed(grid: OccupancyGrid, T_frame_map: Pose) -> OccupancyGrid:
    """The map in the frame that all are drawn in."""
    x, y, theta = se2.compose(T_frame_map, np.asarray(grid.origin)).tolist()
    return replace(grid, origin=(x, y, theta))
