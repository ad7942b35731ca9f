# SPDX-License-Identifier: MIT
"""One drive as a picture: map, true path, path by odometry and one scan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from slam import se2
from slam.occupancy import OccupancyGrid
from testbed.datasets.loading import Dataset

WIDTH, DOTS_PER_INCH = 9.0, 150
"""Width [inch] and resolution of the picture."""
LEGEND_BELOW = 0.5
"""Distance of the legend below the axes, past the label of x [inch]."""
TRUTH, ODOMETRY, SCAN = "#2b8a3e", "#e67700", "#d6336c"
"""The colours of the viewer: green, orange, pink."""
SOLID_GREY, WALL_GREY = 0.75, 0.1
"""Brightness of what is unknown or solid, and of walls; free floor is white."""


def draw_drive(dataset: Dataset, file: Path, title: str, time: float | None = None) -> None:
    """Draw a dataset as a PNG; what it does not have (truth, map) is left out.

    The path by odometry begins at the true start. time: of the scan that is drawn, in seconds since the first one;
    default: the middle of the drive. Raises LogError where the recording has no scan.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.transforms import ScaledTranslation

    truth, odometry = dataset.truth, dataset.odometry
    has_truth = bool(np.isfinite(truth).all(axis=1).any())
    start = truth[0] if has_truth else np.zeros(3)
    by_odometry = se2.compose(start, se2.between(odometry[0], odometry))
    elapsed = dataset.stamps - dataset.stamps[0]
    shown = len(elapsed) // 2 if time is None else int(np.argmin(np.abs(elapsed - time)))
    hits = _hits(dataset, shown, truth[shown] if has_truth else by_odometry[shown])

    figure = Figure(figsize=(WIDTH, WIDTH), layout="constrained")
    ax = figure.add_subplot()
    if (grid := dataset.truth_map) is not None:
        _draw_map(ax, grid)
    ax.plot(*by_odometry[:, :2].T, color=ODOMETRY, lw=1.0, label="odometry, from the true start")
    if has_truth:
        error = float(np.hypot(*(by_odometry[-1, :2] - truth[-1, :2])))
        ax.plot(*by_odometry[-1, :2], "s", color=ODOMETRY, ms=5, label=f"its end, {error:.2f} m off")
    if has_truth:
        ax.plot(*truth[:, :2].T, color=TRUTH, lw=1.4, label="true path")
    path = truth if has_truth else by_odometry
    ax.plot(*path[0, :2], "o", color="black", fillstyle="none", label="start")
    ax.plot(*path[-1, :2], "s", color="black", ms=5, label="end")
    ax.plot(*hits.T, ".", color=SCAN, ms=2.5, label=f"scan at {elapsed[shown]:.1f} s")
    ax.plot(*path[shown, :2], "D", color=SCAN, ms=5, label="robot at that time")
    ax.set(title=title, xlabel="x [m]", ylabel="y [m]", aspect="equal")
    below = ax.transAxes + ScaledTranslation(0.0, -LEGEND_BELOW, figure.dpi_scale_trans)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=below, ncols=3, frameon=False)
    with atomic_write(file) as temporary:
        FigureCanvasAgg(figure).print_figure(temporary, dpi=DOTS_PER_INCH, bbox_inches="tight", format="png")


def _draw_map(ax: Any, grid: OccupancyGrid) -> None:
    """Draw a map in the frame of its poses: free floor white, walls dark, all else grey."""
    occupied = np.nan_to_num(grid.probability)
    shade = np.where(grid.known, 1.0 - (1.0 - WALL_GREY) * occupied, SOLID_GREY)
    x, y, theta = grid.origin
    rows, columns = shade.shape
    extent = (0.0, columns * grid.resolution, 0.0, rows * grid.resolution)
    image = ax.imshow(shade, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent)
    from matplotlib.transforms import Affine2D

    image.set_transform(Affine2D().rotate(theta).translate(x, y) + ax.transData)
    corners = se2.transform_points(np.array([x, y, theta]), np.array([[0.0, 0.0], extent[1::2]]))
    ax.update_datalim(corners)
    ax.autoscale_view()


def _hits(dataset: Dataset, number: int, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the beams of a scan end (n, 2) [m], from the robot's pose (3,)."""
    x, y, theta = se2.compose(pose, np.array(dataset.mount)).tolist()
    low, high = dataset.range_limits
    ranges, directions = dataset.scans[number], theta + dataset.angles[number]
    ends = np.column_stack([x + ranges * np.cos(directions), y + ranges * np.sin(directions)])
    hits: NDArray[np.float64] = ends[(ranges >= low) & (ranges < high)]
    return hits
