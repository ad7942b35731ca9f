# SPDX-License-Identifier: MIT
"""How maps, trajectories, scans, frames, logs and the filter show themselves in a notebook: a line and a picture.

Their classes know nothing of notebooks: `import testbed.library` registers these functions where IPython runs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from eval.report import plots
from eval.report.map_images import draw_map, frame_around
from testbed.library import html

if TYPE_CHECKING:
    from eval.trajectory.trajectory import Trajectory
    from slam.gmapping import GMapping
    from slam.occupancy import OccupancyGrid
    from slam.scan import Scan
    from testbed.formats import Log
    from testbed.frame import Frame

SCAN_INCHES = 4.5


def of_map(grid: OccupancyGrid) -> str:
    """A map as HTML."""
    return html.line(repr(grid)) + _over_map([], grid)


def of_trajectory(trajectory: Trajectory) -> str:
    """A path as HTML."""
    path = ("path", trajectory.poses[:, :2], plots.ESTIMATE)
    return html.line(repr(trajectory)) + html.picture(plots.paths([path]))


def of_scan(scan: Scan) -> str:
    """The hits of a scan in the robot's frame as HTML; the arrow is the robot, which looks to the right."""
    hits, (x, y, turned) = scan.hit, scan.mount
    angles, ranges = scan.angles[hits] + turned, scan.ranges[hits]
    figure = Figure(figsize=(SCAN_INCHES, 0.8 * SCAN_INCHES), layout="constrained")
    ax = figure.add_subplot()
    ax.plot(x + ranges * np.cos(angles), y + ranges * np.sin(angles), ".", ms=3.0, color=plots.ESTIMATE)
    ax.plot(0.0, 0.0, ">", ms=9.0, color="black")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x, forward [m]", ylabel="y, left [m]")
    return html.line(repr(scan)) + html.picture(plots.svg_uri(figure), width=420)


def of_frame(frame: Frame) -> str:
    """A frame with its scan, if it has one, as HTML."""
    return html.line(repr(frame)) + ("" if frame.scan is None else of_scan(frame.scan))


def of_log(log: Log) -> str:
    """The path of a recording by its odometry, and by the truth where that is known, as HTML."""
    table = log.table
    curves: list[plots.Series] = [("odometry", table.odometry[:, :2], plots.ODOMETRY)] if len(table.stamps) else []
    known = np.isfinite(table.truth).all(axis=1)
    if known.any():
        curves.append(("truth", table.truth[known, :2], plots.TRUTH))
    return html.line(repr(log)) + (html.picture(plots.paths(curves)) if curves else "")


def of_filter(mapper: GMapping) -> str:
    """The best particle's map and path as HTML."""
    path: plots.Series = ("path of the best particle", mapper.path()[:, :2], plots.ESTIMATE)
    return html.line(repr(mapper)) + (_over_map([path], mapper.map()) if len(mapper.update_scans) else "")


SHOWN: dict[tuple[str, str], Callable[[Any], str]] = {
    ("slam.occupancy", "OccupancyGrid"): of_map,
    ("eval.trajectory.trajectory", "Trajectory"): of_trajectory,
    ("slam.scan", "Scan"): of_scan,
    ("testbed.frame", "Frame"): of_frame,
    ("testbed.formats.log", "Log"): of_log,
    ("slam.gmapping", "GMapping"): of_filter,
}
"""What shows the objects of a class: by its module and name."""


def register(formatter: Any) -> None:
    """Teach a formatter of IPython for `text/html` to show these objects."""
    for (module, name), function in SHOWN.items():
        formatter.for_type_by_name(module, name, function)


def register_in_notebook() -> None:
    """Teach the notebook that runs this code, if one does."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        register(shell.display_formatter.formatters["text/html"])


def _over_map(curves: list[plots.Series], grid: OccupancyGrid) -> str:
    """Paths over a map as a picture; nothing where no cell is known."""
    if not grid.known.any():
        return ""
    here = np.zeros(3)
    return html.picture(plots.paths(curves, background=draw_map(grid, frame_around(grid, here, [], 0.5), here)))
