# SPDX-License-Identifier: MIT
"""Pictures of several runs on the same data: trajectories, maps and their errors, accuracy against cost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.files.run_reader import RunFiles
from eval.files.tum import read_tum
from eval.report import plots
from eval.report.map_images import DIFFERENCE_KEY, Picture, draw_difference, draw_map, frame_around, frame_over
from eval.report.page import Plot
from eval.report.report_context import positions_in
from eval.trajectory.association import AssociationError, associate
from eval.trajectory.errors import AbsoluteError, absolute_error
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, wrap_angle

COLOURS = ("#1864ab", "#e67700", "#9c36b5", "#c92a2a", "#0b7285", "#846358", "#e64980", "#868e96")
"""Of runs; no green, which is the truth's in recordings."""
MIN_COMMON_SHARE = 0.5
"""Two recordings are the same if so many of the stamps of the shorter one occur in both, with equal poses."""
EQUAL = 1e-6
"""Poses are equal within this [m, rad]; files keep float64, but headings pass through a quaternion."""
MARGIN, MARGIN_SHARE = 1.0, 0.15
"""Paths are drawn with so much of the map about them: this length [m], at least this share of their extent."""
NamedRuns = Sequence[tuple[str, RunFiles]]


def colour_of(number: int) -> str:
    """The colour of a run by its number."""
    return COLOURS[number % len(COLOURS)]


def same_data(first: RunFiles, second: RunFiles) -> bool:
    """Whether two runs are of one recording, by content: their true paths agree, without one their odometry."""
    for name in ("truth", "odometry"):
        one, other = getattr(first, name), getattr(second, name)
        if one is not None and other is not None:
            return _agree(one, other)
    return False


def _agree(first: Trajectory, second: Trajectory) -> bool:
    _, one, other = np.intersect1d(
        np.round(first.stamps, 6), np.round(second.stamps, 6), assume_unique=False, return_indices=True
    )
    if len(one) < max(2.0, MIN_COMMON_SHARE * min(len(set(first.stamps)), len(set(second.stamps)))):
        return False
    apart = first.poses[one] - second.poses[other]
    apart[:, 2] = wrap_angle(apart[:, 2])
    return bool(np.abs(apart).max() <= EQUAL)


@dataclass(frozen=True, eq=False)
class Aligned:
    """A run's path in the frame that all runs are drawn in."""

    name: str
    run: RunFiles
    colour: str
    T_frame_estimate: Pose
    errors: AbsoluteError | None
    """Distance from the truth, or from the first run where there is no truth."""
    stamps: NDArray[np.float64]
    """Stamps of the errors [s]."""


def aligned_runs(runs: NamedRuns) -> list[Aligned]:
    """The runs that have a path, each aligned with the truth, without one with the path of the first run."""
    truth = next((run.truth for _, run in runs if run.truth is not None), None)
    first = next((run.estimate for _, run in runs if run.estimate is not None), None)
    reference = first if truth is None else truth
    found = []
    for number, (name, run) in enumerate(runs):
        if run.estimate is None or reference is None:
            continue
        try:
            matched = associate(run.estimate, reference)
        except AssociationError:
            continue
        errors = absolute_error(matched, "se2")
        T = errors.alignment.T_reference_estimate
        known = None if truth is None else errors
        found.append(Aligned(name, run, colour_of(number), T, known, matched.estimate.stamps))
    return found


def path_plots(runs: NamedRuns) -> Iterator[Plot]:
    """All trajectories over one map, and the error of each over time; nothing where fewer than two runs have a path."""
    aligned = aligned_runs(runs)
    if len(aligned) < 2:
        return
    truth = next((run.truth for _, run in runs if run.truth is not None), None)
    curves: list[plots.Series] = []
    if truth is not None:
        curves.append(("truth", truth.poses[:, :2], plots.TRUTH))
    for path in aligned:
        assert path.run.estimate is not None
        curves.append((path.name, positions_in(path.T_frame_estimate, path.run.estimate), path.colour))
    how = (
        "aligned with the truth over all its poses" if truth is not None else f"aligned with that of {aligned[0].name}"
    )
    background, of = _background(runs, aligned, [path for _, path, _ in curves])
    caption = f"Seen from above{of}; each trajectory is {how}."
    yield Plot("Trajectories", plots.paths(curves, background=background), caption)
    yield from _error_plots(aligned, truth)


def _error_plots(aligned: Sequence[Aligned], truth: Trajectory | None) -> Iterator[Plot]:
    """The error of each final estimate over time, and that of the poses while driving where they are others."""
    judged = [(path, path.errors, path.stamps) for path in aligned if path.errors is not None]
    if len(judged) < 2 or truth is None:
        return
    yield Plot(
        "Position error over time",
        _errors_over_time(judged),
        "Distance of the final estimates from the truth, each after SE(2) alignment of all its poses.",
    )
    online = [(path, *found) for path in aligned if (found := _online_errors(path.run, truth)) is not None]
    same = len(online) == len(judged) and all(
        np.array_equal(errors.translation_errors, final.translation_errors)
        for (_, errors, _), (_, final, _) in zip(online, judged, strict=True)
    )
    if online and not same:
        yield Plot(
            "Position error while driving",
            _errors_over_time(online),
            "The same of the poses that were known at each scan, before any final pass.",
        )


def _online_errors(run: RunFiles, truth: Trajectory) -> tuple[AbsoluteError, NDArray[np.float64]] | None:
    """Errors of the poses while driving, and their stamps [s]; None where the run has none."""
    file = run.path / "online.tum"
    if not file.is_file():
        return None
    try:
        matched = associate(read_tum(file), truth)
    except AssociationError:
        return None
    return absolute_error(matched, "se2"), matched.estimate.stamps


def _errors_over_time(judged: Sequence[tuple[Aligned, AbsoluteError, NDArray[np.float64]]]) -> str:
    """Draw errors [cm] over the time since the first of all stamps [s]."""
    start = min(float(stamps.min()) for _, _, stamps in judged)
    end = max(float(stamps.max()) for _, _, stamps in judged)
    at = np.linspace(start, end, 1000)
    series: list[plots.Series] = []
    for path, errors, stamps in judged:
        order = np.argsort(stamps, kind="stable")
        error = np.interp(at, stamps[order], 100.0 * errors.translation_errors[order], np.nan, np.nan)
        series.append((path.name, error, path.colour))
    return plots.over_time(at - start, series, "error [cm]")


def _background(runs: NamedRuns, aligned: Sequence[Aligned], paths: Sequence[ArrayLike]) -> tuple[Picture | None, str]:
    """The part of a map around paths (n, 2) [m], and a phrase that names it: the true one, else the first of a run."""
    truth = _true_map(runs)
    if truth is not None:
        return part_around(truth, np.zeros(3), paths), " over the true map"
    for path in aligned:
        grid, T = path.run.grid, path.T_frame_estimate
        if grid is not None and grid.known.any():
            return part_around(grid, T, paths), f" over the map of {path.name}"
    return None, ""


def part_around(grid: OccupancyGrid, T_frame_grid: ArrayLike, paths: Sequence[ArrayLike]) -> Picture:
    """Draw the part of a map around paths (n, 2) [m]: several over a whole building would lie on each other."""
    points = np.concatenate([np.asarray(path, dtype=np.float64) for path in paths])
    margin = max(MARGIN, MARGIN_SHARE * float(np.ptp(points, axis=0).max()))
    return draw_map(grid, frame_over(paths, grid.resolution, margin), T_frame_grid)


def _true_map(runs: NamedRuns) -> OccupancyGrid | None:
    return next((run.truth_grid for _, run in runs if run.truth_grid is not None), None)


def map_plots(runs: NamedRuns) -> Iterator[Plot]:
    """The true map, and each map in its frame; nothing where no run has a map."""
    drawn = [path for path in aligned_runs(runs) if path.run.grid is not None and path.run.grid.known.any()]
    if not drawn:
        return
    truth = _true_map(runs)
    if truth is not None:
        around = frame_around(truth, np.zeros(3), [], 1.0)
        yield Plot("truth", draw_map(truth, around, np.zeros(3)).data_uri, "", True)
    for path in drawn:
        grid, T = path.run.grid, path.T_frame_estimate
        assert grid is not None
        place = frame_around(grid, T, [], 0.5) if truth is None else frame_around(truth, np.zeros(3), [], 1.0)
        yield Plot(path.name, draw_map(grid, place, T).data_uri, str(path.run.metric("outcome")), True)


def difference_plots(runs: NamedRuns) -> Iterator[Plot]:
    """The walls of each map against the true ones; nothing where the true map is unknown."""
    truth = _true_map(runs)
    if truth is None:
        return
    around = frame_around(truth, np.zeros(3), [], 1.0)
    for path in aligned_runs(runs):
        grid = path.run.grid
        if grid is not None and grid.known.any():
            picture = draw_difference(grid, truth, around, path.T_frame_estimate)
            yield Plot(path.name, picture.data_uri, pixelated=True, key=DIFFERENCE_KEY)


def cost_plots(runs: NamedRuns) -> Iterator[Plot]:
    """Accuracy against the time per scan, and against memory, one dot a run; nothing for fewer than two dots."""
    accuracy = (
        ("relations.trans_mean_m", "relation error [m]")
        if any(run.metric("relations.trans_mean_m") is not None for _, run in runs)
        else ("trajectory.ate_rmse_m", "trajectory error, rmse [m]")
    )
    key, label = accuracy
    for title, axis, cost in (
        ("Accuracy against time", "whole time by the number of scans [ms]", time_per_scan),
        ("Accuracy against memory", "memory [MB], less than 1 drawn as 1", memory),
    ):
        dots = []
        for number, (name, run) in enumerate(runs):
            x, y = cost(run), run.metric(key)
            if x and y:
                dots.append((name, x, float(y), colour_of(number)))
        if len(dots) > 1:
            source = plots.labelled_dots(dots, axis, label)
            yield Plot(title, source, "Left is cheaper, down is more accurate; both axes are logarithmic.")


def memory(run: RunFiles) -> float | None:
    """Memory of the system [MB], at least 1; None where the run does not say."""
    stated = run.metric("system.memory_mb")
    return None if stated is None else max(float(stated), 1.0)


def time_per_scan(run: RunFiles) -> float | None:
    """Time of the whole estimate by the number of scans [ms]; None where the run does not say."""
    stated = run.metric("system.ms_per_scan")
    if stated is not None:
        return float(stated)
    wall, scans = run.metric("wall_s"), run.metric("scans")
    return 1e3 * float(wall) / float(scans) if wall and scans else None
