# SPDX-License-Identifier: MIT
"""The report of one run: one HTML file that opens anywhere, made from the run directory alone."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from eval.files.run_reader import RunFiles, read_run
from eval.filter.nees import LEVEL, chi_square, nees
from eval.filter.step_table import column, updates
from eval.first_failure import Finding
from eval.report import plots
from eval.report.map_images import DIFFERENCE_KEY, Extent, Picture, draw_difference, draw_map, frame_around
from eval.report.verdict import verdict
from eval.trajectory.association import AssociationError, associate
from eval.trajectory.errors import AbsoluteError, absolute_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import Pose, compose, inverse

CROP = 6.0
"""The picture of the first bad scan shows at most this much around the robot [m]."""


@dataclass(frozen=True)
class Plot:
    """A picture with its words."""

    title: str
    source: str
    """`data:` address."""
    caption: str = ""
    pixelated: bool = False
    key: tuple[tuple[str, str], ...] = ()
    """Colours and what they mean."""


@dataclass(frozen=True, eq=False)
class Sight:
    """A run as the report looks at it: everything in one frame, the truth's where it is known."""

    run: RunFiles
    T_frame_estimate: Pose
    errors: AbsoluteError | None
    """Of the estimate after SE(2) alignment, for the scans `rows`."""
    rows: NDArray[np.intp]

    @property
    def finding(self) -> Finding | None:
        """Where it went wrong."""
        return self.run.finding.finding if self.run.finding is not None else None

    @property
    def start(self) -> float:
        """Stamp that counts as time 0 [s]."""
        return float(self.run.estimate.stamps[0]) if self.run.estimate is not None else 0.0

    @property
    def cursor(self) -> float | None:
        """Time of the first bad scan [s], if there is a bad one."""
        return self.finding.stamp - self.start if self.finding is not None and self.finding.bad else None


def write_report(run_directory: str | os.PathLike[str]) -> Path:
    """Write `report.html` into a run directory, from its other files, and return its path.

    Raises RunFilesError for a directory that holds no run, ValueError for damaged files in it.
    """
    run = read_run(run_directory)
    page = render("report.html.j2", **_context(run))
    path = run.path / "report.html"
    with atomic_write(path) as aside:
        aside.write_text(page, encoding="utf-8")
    return path


def render(template: str, **context: Any) -> str:
    """One of the templates beside this module, filled in; everything is escaped."""
    environment = Environment(
        loader=PackageLoader("eval.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**context)


def _context(run: RunFiles) -> dict[str, Any]:
    sight = _look(run)
    return {
        "name": run.name,
        "verdict": verdict(run),
        "metrics": run.metrics,
        "command": run.config.get("command", ""),
        "finding": sight.finding,
        "finding_time": sight.finding.stamp - sight.start if sight.finding else None,
        "bad_scan": _bad_scan_plot(sight),
        "maps": list(_map_plots(sight)),
        "path_plots": list(_path_plots(sight)),
        "error_plots": list(_error_plots(sight)),
        "filter_plots": list(_filter_plots(sight)),
        "rpe": {_spaced(key): row for key, row in (run.metric("trajectory.rpe") or {}).items()},
        "relations": _relation_rows(run),
        "calibration": _calibration_plot(run),
        "provenance": {key: dict(flat(run.config.get(key, {}))) for key in ("versions", "machine", "inputs")},
        "settings": dict(flat(run.config.get("settings", {}))),
        "all_metrics": {key: _number(value) for key, value in flat(run.metrics) if not isinstance(value, list)},
    }


def flat(document: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of nested tables with their dotted keys."""
    for key, value in document.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _spaced(length: str) -> str:
    """`10s` as people write it."""
    return f"{length[:-1]}\N{NO-BREAK SPACE}{length[-1]}"


def _number(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _look(run: RunFiles) -> Sight:
    errors, rows = None, np.zeros(0, dtype=np.intp)
    if run.estimate is not None and run.truth is not None:
        with suppress(AssociationError):
            matched = associate(run.estimate, run.truth)
            errors, rows = absolute_error(matched, "se2"), matched.rows
    return Sight(run, errors.alignment.T_reference_estimate if errors else np.zeros(3), errors, rows)


# --- maps and paths


def _map_plots(sight: Sight) -> Iterator[Plot]:
    run, T = sight.run, sight.T_frame_estimate
    if run.grid is None:
        return
    around = frame_around(run.grid, T, [], 0.5)
    if run.truth_grid is not None:
        around = frame_around(run.truth_grid, np.zeros(3), [], 1.0)
    cell = f"cells of {100.0 * run.grid.resolution:.3g} cm"
    yield Plot(
        "Estimated map" if run.metrics.get("localization") is None else "Given map",
        draw_map(run.grid, around, T).data_uri,
        f"Black: wall, white: free, grey: never seen; {cell}.",
        True,
    )
    if run.truth_grid is not None:
        truth = draw_map(run.truth_grid, around, np.zeros(3))
        yield Plot("True map", truth.data_uri, "What a perfect mapper could know of this world.", True)
        difference = draw_difference(run.grid, run.truth_grid, around, T)
        yield Plot("Difference", difference.data_uri, pixelated=True, key=DIFFERENCE_KEY)


def _background(sight: Sight) -> Picture | None:
    run = sight.run
    if run.grid is None or not run.grid.known.any():
        return None
    positions = [] if run.estimate is None else [_moved(run.estimate, sight.T_frame_estimate)]
    return draw_map(
        run.grid, frame_around(run.grid, sight.T_frame_estimate, list(positions), 0.5), sight.T_frame_estimate
    )


def _path_plots(sight: Sight) -> Iterator[Plot]:
    run = sight.run
    if run.estimate is None:
        return
    background, estimate = _background(sight), _moved(run.estimate, sight.T_frame_estimate)
    curves: list[plots.Series] = []
    if run.odometry is not None:
        curves.append(("odometry", _moved(run.odometry, _odometry_alignment(sight)), plots.ODOMETRY))
    if run.truth is not None:
        curves.append(("truth", run.truth.poses[:, :2], plots.TRUTH))
    curves.append(("estimate", estimate, plots.ESTIMATE))
    how = "aligned to the truth over all poses" if sight.errors else "odometry starts at the estimate's first pose"
    yield Plot(
        "Trajectories", plots.paths(curves, background=background), f"Seen from above over the estimated map; {how}."
    )
    if sight.errors is not None:
        source = plots.error_by_place(estimate[sight.rows], sight.errors.translation_errors, background=background)
        yield Plot(
            "Error by place", source, "The estimated path, coloured by its distance from the true one at that time."
        )


def _odometry_alignment(sight: Sight) -> Pose:
    """Frame of the odometry seen from the report's: by the truth, else by the estimate's first pose."""
    run = sight.run
    assert run.odometry is not None
    assert run.estimate is not None
    if run.truth is not None and sight.errors is not None:
        return absolute_error(associate(run.odometry, run.truth), "se2").alignment.T_reference_estimate
    return compose(compose(sight.T_frame_estimate, run.estimate.poses[0]), inverse(run.odometry.poses[0]))


def _bad_scan_plot(sight: Sight) -> Plot | None:
    """The scan of the finding over a map, drawn from where the robot was thought to be and from where it was."""
    run = sight.run
    if run.finding is None or run.estimate is None or run.finding.finding.scan >= len(run.estimate):
        return None
    finding, points = run.finding.finding, run.finding.points
    T_frame_map = compose(finding.believed, inverse(run.estimate.poses[finding.scan]))
    curves: list[plots.Series] = []
    if run.truth is not None:
        curves.append(("true path", run.truth.poses[:, :2], plots.TRUTH))
    around = run.estimate[max(finding.since - 50, 0) : finding.scan + 50]
    curves.append(("estimated path", _moved(around, T_frame_map), plots.ESTIMATE))
    seen = [plots.SeenScan("scan, as estimated", finding.believed, points, plots.BAD)]
    if finding.expected is not None:
        seen.insert(0, plots.SeenScan("scan, where it truly was", finding.expected, points, plots.GOOD))
    grid, T, caption = run.grid, T_frame_map, "Over the estimated map."
    if run.truth is not None and run.truth_grid is not None:
        grid, T = run.truth_grid, np.zeros(3)
        caption = (
            f"Over the true map; the estimate is laid upon the truth at scan {finding.since}. The green scan lies on "
            "the walls; where the red one lies beside it the estimate is wrong."
        )
    window = _window(finding, points)
    background = None
    if grid is not None and grid.known.any():
        background = draw_map(grid, frame_around(grid, T, [], 0.5), T)
    source = plots.scan_over_map(seen, curves, background=background, window=window)
    return Plot(f"Around scan {finding.scan}", source, caption)


def _window(finding: Finding, points: NDArray[np.float64]) -> Extent:
    """What to show (x, x, y, y) [m]: both places, and most of the scan but no more than `CROP` around each."""
    corners = []
    for place in (finding.believed, finding.expected):
        if place is not None:
            reach = np.percentile(np.hypot(*points.T), 90.0) if len(points) else 0.0
            reach = np.clip(reach, 2.0, CROP)
            corners += [place[:2] - reach, place[:2] + reach]
    (left, low), (right, high) = np.min(corners, axis=0), np.max(corners, axis=0)
    # In the proportions of a plot: a strip would be drawn small.
    wider = max(0.0, 0.5 * ((high - low) / 0.75 - (right - left)))
    higher = max(0.0, 0.5 * (0.75 * (right - left) - (high - low)))
    return float(left - wider), float(right + wider), float(low - higher), float(high + higher)


def _moved(trajectory: Trajectory, T: Pose) -> NDArray[np.float64]:
    """Positions (n, 2) seen from another frame."""
    return compose(T, trajectory.poses)[:, :2]


# --- over time


def _error_plots(sight: Sight) -> Iterator[Plot]:
    run, errors = sight.run, sight.errors
    if errors is None or run.estimate is None:
        return
    time = run.estimate.stamps[sight.rows] - sight.start
    position: list[plots.Series] = [("final", 100.0 * errors.translation_errors, plots.ESTIMATE)]
    heading: list[plots.Series] = [("final", errors.rotation_errors, plots.ESTIMATE)]
    marks = {}
    if run.steps is not None and run.truth is not None:
        online = Trajectory(
            column(run.steps, "stamp"), np.column_stack([column(run.steps, name) for name in ("x", "y", "theta")])
        )
        if np.array_equal(online.stamps, run.estimate.stamps):
            live = absolute_error(associate(online[sight.rows], run.truth), "se2")
            if len(live.translation_errors) == len(time):
                position.insert(0, ("while driving", 100.0 * live.translation_errors, "#a5b8cf"))
                heading.insert(0, ("while driving", live.rotation_errors, "#a5b8cf"))
        marks = {
            "resampled": (online.stamps[column(run.steps, "resampled") == 1.0] - sight.start, plots.ODOMETRY),
            "loop closed": (online.stamps[column(run.steps, "loop_closed") == 1.0] - sight.start, "#2b8a3e"),
        }
    aligned = "After SE(2) alignment of all poses."
    yield Plot(
        "Position error",
        plots.over_time(time, position, "error [cm]", marks=marks, cursor=sight.cursor),
        f"{aligned} “While driving”: the best particle at that moment; “final”: the path believed in the end."
        if len(position) > 1
        else aligned,
    )
    yield Plot("Heading error", plots.over_time(time, heading, "error [deg]", cursor=sight.cursor), aligned)


def _filter_plots(sight: Sight) -> Iterator[Plot]:
    steps = sight.run.steps
    if steps is None or not updates(steps).any():
        return
    on = updates(steps)
    time = column(steps, "stamp")[on] - sight.start
    particles = column(steps, "particles")[on]
    resampled = time[column(steps, "resampled")[on] == 1.0]
    yield Plot(
        "Effective sample size",
        plots.over_time(
            time,
            [("particles", particles, plots.QUIET), ("effective", column(steps, "ess")[on], plots.ESTIMATE)],
            "particles",
            marks={"resampled": (resampled, plots.ODOMETRY)},
            cursor=sight.cursor,
        ),
        "How many particles carry weight, before resampling.",
    )
    yield Plot(
        "Particle ancestry",
        plots.over_time(
            time,
            [("founders alive", column(steps, "unique_ancestors")[on], plots.ESTIMATE)],
            "founders",
            cursor=sight.cursor,
        ),
        "Founders whose descendants are alive. At one, all particles share their past and older loops cannot be "
        "mended any more; counting then starts anew.",
    )
    share = 100.0 * column(steps, "matched_share")[on]
    failed = 100.0 * column(steps, "match_failures")[on] / particles
    if np.nansum(share) + np.nansum(failed) > 0.0:  # the motion proposal matches nothing
        yield Plot(
            "Scan matching",
            plots.over_time(
                time,
                [("beams on known walls", share, plots.ESTIMATE), ("particles that failed", failed, plots.BAD)],
                "share [%]",
                cursor=sight.cursor,
            ),
            "Unseen places lower the share of matched beams; failures are what breaks maps.",
        )
    parts = {
        stage: 1e3 * column(steps, f"{stage}_s")[on]
        for stage in plots.STAGES
        if np.nansum(column(steps, f"{stage}_s")[on]) > 0.0
    }
    if parts:
        source = plots.stacked_over_time(time, parts, "time per update [ms]")
        yield Plot("Where the time goes", source, f"All {particles[-1]:.0f} particles together.")
    rows, values, _ = nees(steps)
    if len(rows) > 1:
        low, high = (chi_square(part, 3) for part in ((1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0))
        at = column(steps, "stamp")[rows] - sight.start
        yield Plot(
            "Consistency (NEES)",
            plots.over_time(
                at, [("NEES", np.maximum(values, 1e-3), plots.ESTIMATE)], "NEES", band=(low, high), log=True
            ),
            "Squared error in units of the stated covariance. In the green band the filter is as sure as it may be; "
            "above it is too sure of itself.",
        )


# --- tables


def _calibration_plot(run: RunFiles) -> Plot | None:
    bins = run.metric("map.calibration")
    if not bins:
        return None
    stated, observed, cells = ([part[key] for part in bins] for key in ("stated", "observed", "cells"))
    return Plot(
        "Are the map's probabilities honest?",
        plots.calibration(stated, observed, cells),
        "Cells grouped by the probability that the map states, against the share that is truly occupied.",
    )


def _relation_rows(run: RunFiles) -> list[tuple[str, dict[str, Any]]]:
    rows = [("all pairs", run.metric("relations")), ("up to 20 s apart", run.metric("relations.short"))]
    rows.append(("loops, further apart", run.metric("relations.loops")))
    return [(name, row) for name, row in rows if row]
