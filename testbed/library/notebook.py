# SPDX-License-Identifier: MIT
"""How objects of the other packages show themselves in a notebook: a picture or a table below their line of text.

Registered with IPython when `testbed.library` is imported there, since `slam` knows of no pictures.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from eval.report import plots
from eval.report.map_images import draw_map, frame_around, frame_over
from eval.sweep.results import SweepTable
from eval.sweep.summary import summarise
from eval.sweep.systems_page import place_tables
from eval.trajectory.trajectory import Trajectory
from slam import GMapping, OccupancyGrid, Recording, Refined, Scan, StepReport
from slam.se2 import Pose
from slam.sensor.rays import make_rays
from testbed.datasets import Collection, Dataset
from testbed.formats import Log
from testbed.frame import Frame
from testbed.library import html
from testbed.systems.feeding import Estimated

MAX_ROWS = 20
"""Rows of a collection that are shown."""


def html_of(thing: object) -> str | None:
    """Return what a notebook shows of an object; None where it is of no kind in `SHOWN`."""
    show = SHOWN.get(type(thing))
    return None if show is None else html.line(repr(thing)) + show(thing)


def register() -> bool:
    """Tell the notebook that this runs in, if any, how to show objects; returns whether there is one."""
    interactive = sys.modules.get("IPython")
    shell = None if interactive is None else interactive.get_ipython()
    if shell is None:
        return False
    formatter = shell.display_formatter.formatters["text/html"]
    for kind in SHOWN:
        formatter.for_type(kind, html_of)
    return True


def _map(grid: OccupancyGrid) -> str:
    if not grid.known.any():
        return ""
    return html.picture(draw_map(grid, frame_around(grid, np.zeros(3), [], 0.5), np.zeros(3)).data_uri)


def _path(path: Pose, grid: OccupancyGrid | None = None, name: str = "estimate") -> str:
    """Draw a path (n, 3) from above, over a map that is in its frame."""
    background = None
    if grid is not None and grid.known.any():
        background = draw_map(grid, frame_around(grid, np.zeros(3), [], 0.5), np.zeros(3))
    return html.picture(plots.paths([(name, path[:, :2], plots.ESTIMATE)], background=background))


def _mapper(mapper: GMapping) -> str:
    return _path(mapper.path(), mapper.map(), "best particle") if len(mapper.update_scans) else ""


def _scan(scan: Scan) -> str:
    """Draw the hits about the robot."""
    rays = make_rays([scan], usable_range=scan.range_max)
    points = rays.ends[rays.hit]
    if not len(points):
        return ""
    shown = plots.SeenScan("hits of the scan", np.zeros(3), points, plots.ESTIMATE, plots.SCAN)
    around = frame_over([points, np.zeros((1, 2))], 0.1, 0.5)
    (x, y, _), (rows, cols) = around.origin, around.probability.shape
    window = (x, x + cols * around.resolution, y, y + rows * around.resolution)
    return html.picture(plots.scan_over_map([shown], [], background=None, window=window), width=450)


def _step(report: StepReport) -> str:
    values = [(field.name, getattr(report, field.name)) for field in fields(report)]
    return html.table(("", ""), [(name, _short(value)) for name, value in values if _is_plain(value)])


def _is_plain(value: object) -> bool:
    return isinstance(value, bool | int | float | str | np.ndarray)


def _short(value: Any) -> str:
    """Numbers with four digits, arrays too."""
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=4, suppress_small=True)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _dataset(dataset: Dataset) -> str:
    """Draw the path of what has been read; nothing is read for the picture."""
    if "log" not in dataset.__dict__ or not len(dataset):
        return ""
    truth = dataset.truth
    known = np.isfinite(truth).all(axis=1)
    return _path(truth[known], name="truth") if known.any() else _path(dataset.odometry, name="odometry")


def _log(log: Log) -> str:
    """Draw the path by the odometry, and by the truth where that is known."""
    table = log.table
    known = np.isfinite(table.truth).all(axis=1)
    curves: list[plots.Series] = [("odometry", table.odometry[:, :2], plots.ODOMETRY)] if len(table.stamps) else []
    curves += [("truth", table.truth[known, :2], plots.TRUTH)] if known.any() else []
    return html.picture(plots.paths(curves)) if curves else ""


def _collection(collection: Collection) -> str:
    names = ("name", "world", "split", "robot", "lidar", "seconds", "metres", "scans")
    rows = [tuple(_short(row.get(name, "")) for name in names) for row in collection.rows]
    rest = len(rows) - MAX_ROWS
    return html.table(names, rows[:MAX_ROWS]) + (html.line(f"… and {rest} more") if rest > 0 else "")


def _sweep(table: SweepTable) -> str:
    """The table of each place, where systems are compared."""
    shown = place_tables(summarise(table.judged())) if len(table.counts) == 1 else []
    return "".join(html.line(place.title) + html.table(place.headings, place.rows) for place in shown)


SHOWN: dict[type, Callable[[Any], str]] = {
    OccupancyGrid: _map,
    Trajectory: lambda trajectory: _path(trajectory.poses, name="trajectory"),
    GMapping: _mapper,
    Recording: lambda recording: _mapper(recording.mapper),
    Refined: lambda refined: _path(refined.poses, refined.map, "after the final pass"),
    Estimated: lambda estimated: _path(estimated.dense.poses, estimated.grid),
    StepReport: _step,
    Scan: _scan,
    Frame: lambda frame: "" if frame.scan is None else _scan(frame.scan),
    Dataset: _dataset,
    Log: _log,
    Collection: _collection,
    SweepTable: _sweep,
}
"""What is shown below the line of each kind of object."""
