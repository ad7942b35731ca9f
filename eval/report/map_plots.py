# SPDX-License-Identifier: MIT
"""Plots of a run that show places: maps, paths, and the scan where it went wrong."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from eval.consistency import LEVEL, chi_square
from eval.filter.step_table import pose_columns
from eval.first_failure import Failure
from eval.report import plots
from eval.report.check_story import place_of_first_sign
from eval.report.map_images import DIFFERENCE_KEY, Extent, Picture, draw_difference, draw_map, frame_around
from eval.report.page import Plot
from eval.report.report_context import ReportContext, positions_in
from eval.wording import at_time
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, compose, inverse, rotation

TRUTH = plots.GOOD
"""The truth is green, as in the recording and in the pictures of moments."""
CROPS = (1.5, 2.5, 4.0, 6.0)
"""The picture of the failure shows as much around the robot [m] as the first of these that is enough: …"""
CROP_GAPS = 3.0
"""… so many times the distance of the two poses, …"""
CROP_SHARE, CROP_POINTS = 0.3, 40
"""… and this share of the scan, or so many of its end points."""
ELLIPSES = 40
"""Ellipses along the path."""
ELLIPSE_SCALES = (1, 2, 5, 10, 20, 50, 100, 200)
"""Enlargements of ellipses: the largest that keeps …"""
ELLIPSE_SHARE = 0.04
"""… the largest of them within this share of the building."""


def map_plots(context: ReportContext) -> Iterator[Plot]:
    """The estimated map, the true one and their difference; nothing where the run has no map."""
    run, T = context.run, context.T_frame_estimate
    if run.grid is None:
        return
    around = frame_around(run.grid, T, [], 0.5)
    if run.truth_grid is not None:
        around = frame_around(run.truth_grid, np.zeros(3), [], 1.0)
    cell = f"cells of {100.0 * run.grid.resolution:.3g} cm"
    yield Plot(
        "Estimated map" if run.metrics.get("localization") is None else "Given map",
        draw_map(run.grid, around, T).data_uri,
        f"Black: wall. White: free. Grey: never seen; {cell}.",
        True,
    )
    if run.truth_grid is not None:
        truth = draw_map(run.truth_grid, around, np.zeros(3))
        yield Plot("True map", truth.data_uri, "The map that a perfect mapper would make of this world.", True)
        difference = draw_difference(run.grid, run.truth_grid, around, T)
        caption = "After alignment of the path over all poses, as all measures of the map." if context.errors else ""
        yield Plot("Difference", difference.data_uri, caption, pixelated=True, key=DIFFERENCE_KEY)


def path_plots(context: ReportContext) -> Iterator[Plot]:
    """All paths over the estimated map, and the error along the estimated one."""
    run = context.run
    if run.estimate is None:
        return
    T = context.T_frame_start
    background, estimate = _background(context, T), positions_in(T, run.estimate)
    curves: list[plots.Series] = []
    if run.odometry is not None:
        curves.append(("odometry", positions_in(context.T_frame_odometry, run.odometry), plots.ODOMETRY))
    if run.truth is not None:
        curves.append(("truth", run.truth.poses[:, :2], TRUTH))
    curves.append(("estimate", estimate, plots.ESTIMATE))
    how = "aligned at the first scan" if context.errors else "odometry starts at the estimate's first pose"
    place = place_of_first_sign(context)
    mark = None if place is None else ("first sign of the self-check", place)
    source = plots.paths(curves, background=background, mark=mark)
    yield Plot("Trajectories", source, f"Seen from above over the estimated map; {how}.")
    if context.errors is not None:
        yield _error_by_place(context)
    if run.covariances is not None and len(run.covariances) == len(estimate):
        yield _uncertainty(context, run.covariances)


def _uncertainty(context: ReportContext, covariances: NDArray[np.float64]) -> Plot:
    """Ellipses in which the positions of the final path lie with 95 %, enlarged so that they can be seen."""
    run, T = context.run, context.T_frame_start
    assert run.estimate is not None
    path = positions_in(T, run.estimate)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    rows = np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], ELLIPSES)).clip(max=len(path) - 1))
    R = rotation(T[2])[:2, :2]
    shapes = chi_square(LEVEL, 2) * (R @ covariances[rows, :2, :2] @ R.T)
    largest = float(np.sqrt(np.linalg.eigvalsh(shapes)[:, -1].max()))
    room = ELLIPSE_SHARE * float(np.ptp(path, axis=0).max())
    scale = max((s for s in ELLIPSE_SCALES if s * largest <= room), default=1)
    source = plots.ellipses(path, path[rows], scale**2 * shapes, background=_background(context, T))
    enlarged = "in their true size" if scale == 1 else f"drawn {scale} times larger"
    inside = run.metric("covariance.inside_95_share")
    judged = (
        ""
        if inside is None
        else f" The truth (position and heading) lies inside at {100.0 * inside:.0f} % of the poses."
    )
    caption = (
        f"Where the positions lie with 95 %, relative to the first pose, as the final pass itself says: {enlarged}. "
        f"The largest reaches {100.0 * largest:.1f} cm.{judged}"
    )
    return Plot("How far the final path may err", source, caption)


def _error_by_place(context: ReportContext) -> Plot:
    """The errors of the final path along it, with the alignment of the trajectory error (ATE), which is their root mean
    square. A path that does not come back to the truth is aligned at the first scan: the other alignment would spread
    the error of its end over all of it."""
    assert context.errors is not None
    assert context.run.estimate is not None
    T, errors = context.T_frame_estimate, context.errors.translation_errors
    how, why = "aligned over all poses", "their root mean square is the trajectory error (ATE)"
    if context.failure_time is not None:
        T, errors = context.T_frame_start, context.errors_from_start()[0]
        how, why = (
            "aligned at the first scan",
            "aligned over all poses, what is wrong at the end would spoil the beginning",
        )
    path = positions_in(T, context.run.estimate)[context.rows]
    source = plots.error_by_place(path, errors, background=_background(context, T))
    caption = f"Colour: distance of the final path from the true one at that time, {how}; {why}."
    return Plot(f"Error by place, {how}", source, caption)


def loop_plots(context: ReportContext) -> Iterator[Plot]:
    """The loops that the final pass found, as links between the two visits; nothing where it found none."""
    run = context.run
    found = run.metric("loops.list")
    if not found or run.estimate is None:
        return
    path, stamps = positions_in(context.T_frame_start, run.estimate), run.estimate.stamps
    times: dict[tuple[str, str], list[tuple[float, float]]] = {
        ("closed by the filter", plots.LOOP_CLOSED): [],
        ("left open by the filter", plots.LOOP_LEFT_OPEN): [],
        ("rejected", plots.BAD): [],
    }
    kinds = list(times)
    for row in found:
        kind = kinds[2] if not row["accepted"] else kinds[0] if row["closed_by_filter"] else kinds[1]
        times[kind].append((row["seen_before_stamp"], row["stamp"]))
    groups = []
    for (name, colour), visits in times.items():
        if visits:
            rows = np.clip(np.searchsorted(stamps, visits), 0, len(stamps) - 1)
            groups.append((f"{name} ({len(visits)})", path[rows], colour))
    source = plots.links(path, groups, background=_background(context, context.T_frame_start))
    caption = (
        "A link joins the middles of two stretches that show the same walls. The final pass found them after the "
        "drive, between pieces of the map; the times are not those at which old walls came into view while driving."
    )
    yield Plot("Loops", source, caption)


def _background(context: ReportContext, T: Pose) -> Picture | None:
    """The estimated map, seen from the report's frame by the alignment T (3,); None where nothing of it is known."""
    run = context.run
    if run.grid is None or not run.grid.known.any():
        return None
    positions = [] if run.estimate is None else [positions_in(T, run.estimate)]
    return draw_map(run.grid, frame_around(run.grid, T, list(positions), 0.5), T)


def failure_plots(context: ReportContext) -> Iterator[Plot]:
    """The scan where it went wrong, drawn from the estimated pose and from the true one over the true map, without
    truth over the estimated one; nothing where there is none."""
    run, failure = context.run, _shown_failure(context)
    if run.estimate is None or failure is None:
        return
    caption = "Drawn over the estimated map."
    if run.truth is not None and run.truth_grid is not None:
        caption = (
            "Green rings: the scan drawn from the true pose. Pink dots: the same scan drawn from the estimated pose. "
            f"The gap is the error. Drawn over the true map; both paths are aligned at scan {failure.since}"
            f"{_why_there(failure)}."
        )
    time = run.estimate.stamps[failure.shown_scan] - context.start
    source = _scan_over_map(context, failure, _map_of_failure(context, failure))
    yield Plot(f"Around scan {failure.shown_scan}, {at_time(time)}", source, caption)


def failure_over_map(context: ReportContext, grid: OccupancyGrid, time: float) -> Plot | None:
    """The same over the map while driving at a time since the start [s]; None where the pose in it is unknown."""
    failure = _shown_failure(context)
    background = None if failure is None else _laid_under_estimate(context, failure, grid)
    if failure is None or background is None:
        return None
    twice = " Where rings and dots both lie on walls, it holds two copies of them."
    if failure.true_pose is None:  # there are no rings
        twice = ""
    return Plot(
        f"The same over the estimate's map of {at_time(time)}",
        _scan_over_map(context, failure, background),
        f"The map at the update before, laid under the estimated pose.{twice}",
    )


def _laid_under_estimate(context: ReportContext, failure: Failure, grid: OccupancyGrid) -> Picture | None:
    """A map while driving in the frame of a failure, laid so that the pose while driving is the estimated one there."""
    steps = context.run.steps
    in_map = np.zeros((0, 3)) if steps is None else pose_columns(steps)
    if failure.shown_scan >= len(in_map):
        return None
    return _laid(grid, compose(failure.estimated, inverse(in_map[failure.shown_scan])))


def _shown_failure(context: ReportContext) -> Failure | None:
    """The failure, or the worst metre, of which a scan can be shown; None where there is none."""
    run, shown = context.run, context.run.failure
    if shown is None or run.estimate is None or shown.failure.shown_scan >= len(run.estimate):
        return None
    return shown.failure


def _scan_over_map(context: ReportContext, failure: Failure, background: Picture | None) -> str:
    """Draw the scan of a failure from both poses, and the paths, over a map."""
    run, shown = context.run, context.run.failure
    assert run.estimate is not None
    assert shown is not None
    T_frame_map = compose(failure.estimated, inverse(run.estimate.poses[failure.shown_scan]))
    curves: list[plots.Series] = []
    if run.truth is not None:
        curves.append(("true path", run.truth.poses[:, :2], TRUTH))
    begin, end = sorted((failure.since, failure.shown_scan))  # a single wrong pose may come before `since`
    around = run.estimate[max(begin - 50, 0) : end + 50]
    curves.append(("estimated path", positions_in(T_frame_map, around), plots.ESTIMATE))
    points = shown.points
    seen = [plots.SeenScan("scan from the estimated pose", failure.estimated, points, plots.ESTIMATE, plots.SCAN)]
    if failure.true_pose is not None:
        seen.insert(0, plots.SeenScan("scan from the true pose", failure.true_pose, points, TRUTH, TRUTH))
    window = _window(failure, points, _map_of_failure(context, failure))  # the same over any map
    return plots.scan_over_map(seen, curves, background=background, window=window)


def _map_of_failure(context: ReportContext, failure: Failure) -> Picture | None:
    """The true map where it is known, else the estimated one, in the frame of a failure; None where there is none."""
    run = context.run
    assert run.estimate is not None
    if run.truth is not None and run.truth_grid is not None:
        return _laid(run.truth_grid, np.zeros(3))
    return _laid(run.grid, compose(failure.estimated, inverse(run.estimate.poses[failure.shown_scan])))


def _laid(grid: OccupancyGrid | None, T: Pose) -> Picture | None:
    """A map seen from the report's frame by the alignment T (3,); None where nothing of it is known."""
    return None if grid is None or not grid.known.any() else draw_map(grid, frame_around(grid, T, [], 0.5), T)


def _why_there(failure: Failure) -> str:
    """Why the paths are aligned at the scan that a failure is measured from."""
    if failure.since == failure.scan:
        return ""
    if failure.bad:
        return ", from which on the motion to this one is wrong"
    end = "begins" if failure.since < failure.scan else "ends"
    return f", where the worst metre of path {end}: of its two ends the one whose pose fits its neighbours"


def _window(failure: Failure, points: NDArray[np.float64], background: Picture | None) -> Extent:
    """What to show (x, x, y, y) [m]: both poses and the part of the scan about them, no more than the background."""
    poses = [pose[:2] for pose in (failure.estimated, failure.true_pose) if pose is not None]
    reach = _crop(points, float(np.hypot(*(poses[0] - poses[-1]))))
    (left, low), (right, high) = np.min(poses, axis=0) - reach, np.max(poses, axis=0) + reach
    if background is not None:
        x_min, x_max, y_min, y_max = background.extent
        left, right, low, high = max(left, x_min), min(right, x_max), max(low, y_min), min(high, y_max)
        if not (right > left and high > low):  # lost so far away that nothing of the map is there
            return _window(failure, points, None)
    return float(left), float(right), float(low), float(high)


def _crop(points: NDArray[np.float64], gap: float) -> float:
    """How much to show around a robot [m] that sees end points (k, 2) [m], where two poses lie so far apart [m]."""
    distances = np.max(np.abs(points), axis=1) if len(points) else np.zeros(1)
    for crop in CROPS:
        seen = int(np.count_nonzero(distances <= crop))
        if crop >= CROP_GAPS * gap and seen >= min(CROP_SHARE * len(points), CROP_POINTS):
            return crop
    return CROPS[-1]
