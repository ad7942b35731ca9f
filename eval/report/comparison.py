# SPDX-License-Identifier: MIT
"""Several runs side by side, as one HTML file: their settings that differ, and their results."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eval.files.atomic_write import atomic_write
from eval.files.run_reader import RunFiles, read_run
from eval.report import comparison_plots, plots
from eval.report.comparison_plots import colour_of, same_data
from eval.report.map_images import draw_map, frame_around
from eval.report.page import Plot, flat, render
from eval.report.verdict import OUTCOME_SENTENCES
from eval.trajectory.association import AssociationError, associate
from eval.trajectory.errors import absolute_error
from slam.se2 import Pose

UNNAMED = "–"
"""Stands for a place that a run does not name."""
MAX_PICTURES = 12
"""Maps and curves are drawn for this many runs at most."""


@dataclass(frozen=True)
class Measure:
    """One row of the table of results."""

    key: str
    """Key in `metrics.json`, with dots."""
    label: str
    number_format: str
    factor: float = 1.0
    better: int = -1
    """-1: less is better; 1: more is better; 0: neither."""


MEASURES = (
    Measure("trajectory.ate_rmse_m", "trajectory error, rmse [cm]", "{:.2f}", 100.0),
    Measure("trajectory_online.ate_rmse_m", "the same while driving, rmse [cm]", "{:.2f}", 100.0),
    Measure("trajectory.ate_max_m", "trajectory error, worst [cm]", "{:.1f}", 100.0),
    Measure("trajectory.heading_rmse_deg", "heading error, rmse [deg]", "{:.3f}"),
    Measure("trajectory.rpe.1m.trans_rmse_m", "error per 1 m of path [cm]", "{:.2f}", 100.0),
    Measure("trajectory.drift_percent", "drift [% of distance]", "{:.2f}"),
    Measure("trajectory.odometry.ate_rmse_m", "odometry alone, rmse [cm]", "{:.1f}", 100.0, 0),
    Measure("relations.trans_mean_m", "relation error [cm]", "{:.2f}", 100.0),
    Measure("relations_online.trans_mean_m", "the same while driving [cm]", "{:.2f}", 100.0),
    Measure("relations.loops.trans_mean_m", "relation error, loops [cm]", "{:.2f}", 100.0),
    Measure("relations.rot_mean_deg", "relation error [deg]", "{:.3f}"),
    Measure("map.wall_distance_m", "walls from truth [cm]", "{:.2f}", 100.0),
    Measure("map.iou", "IoU of walls", "{:.3f}", 1.0, 1),
    Measure("map.f1_1_cells", "F1 of walls within a cell", "{:.3f}", 1.0, 1),
    Measure("map.double_wall_rate", "double walls [%]", "{:.2f}", 100.0),
    Measure("map.log_loss", "log loss of the map [nats]", "{:.4f}"),
    Measure("map.coverage", "coverage [%]", "{:.1f}", 100.0, 1),
    Measure("particles", "particles", "{:.0f}", 1.0, 0),
    Measure("filter.mean_ess", "effective particles", "{:.1f}", 1.0, 0),
    Measure("filter.resamplings", "resamplings", "{:.0f}", 1.0, 0),
    Measure("filter_s", "time in the filter [s]", "{:.2f}"),
    Measure("realtime_factor", "speed [x real time]", "{:.1f}", 1.0, 1),
    Measure("peak_rss_mb", "memory [MB]", "{:.0f}"),
    Measure("system.ms_per_scan", "system: whole time by the number of scans [ms]", "{:.2f}"),
    Measure("system.ms_per_scan_p95", "system: 95 % of the scans take at most [ms]", "{:.2f}"),
    Measure("system.finish_s", "system: time after the last scan [s]", "{:.2f}"),
    Measure("system.memory_mb", "system: memory [MB]", "{:.0f}"),
)


def write_comparison(run_directories: Sequence[str | os.PathLike[str]], out: str | os.PathLike[str]) -> Path:
    """Compare two or more runs in the file `out`, and return its path.

    Raises ValueError for fewer than two directories, RunFilesError where one holds no run.
    """
    if len(run_directories) < 2:
        raise ValueError(f"a comparison takes two or more run directories, got {len(run_directories)}")
    runs = [read_run(directory) for directory in run_directories]
    named = list(zip(_names(runs), runs, strict=True))
    places, one_recording = _places(runs)
    one_place = one_recording or len(set(places)) == 1
    drawn = named[:MAX_PICTURES]
    page = render(
        "comparison.html.j2",
        runs=[(name, run.metric("outcome"), _severity(run), run.metric("outcome_reason")) for name, run in named],
        failures=_failures(runs),
        places=places,
        one_place=one_place,
        results=[row for measure in MEASURES if (row := _result_row(measure, runs, mark_best=one_place)) is not None],
        settings=_differing_settings(runs),
        paths=[*comparison_plots.path_plots(drawn), *comparison_plots.cost_plots(drawn)] if one_recording else [],
        plots=[] if one_recording else _curves(drawn),
        reasons=[_why_it_failed(run) for run in runs],
        maps=list(comparison_plots.map_plots(drawn)) if one_recording else _maps(drawn),
        differences=list(comparison_plots.difference_plots(drawn)) if one_recording else [],
        left_out=max(0, len(runs) - MAX_PICTURES),
    )
    path = Path(out)
    with atomic_write(path) as aside:
        aside.write_text(page, encoding="utf-8")
    return path


def _names(runs: Sequence[RunFiles]) -> list[str]:
    """Names of the directories, with their parents' where two are the same."""
    counts = Counter(run.name for run in runs)
    return [run.name if counts[run.name] == 1 else "/".join(run.path.resolve().parts[-2:]) for run in runs]


def _severity(run: RunFiles) -> str:
    return OUTCOME_SENTENCES.get(str(run.metric("outcome")), ("", "none"))[1]


def _why_it_failed(run: RunFiles) -> str:
    """Why a run has no result, or one that counts as failed; empty for others."""
    return str(run.metric("reason") or (run.metric("outcome_reason") if _severity(run) == "bad" else "") or "")


def _failures(runs: Sequence[RunFiles]) -> str:
    """State how many of the runs that can be judged failed: a mean over runs hides failures."""
    judged = [severity for severity in map(_severity, runs) if severity != "none"]
    if not judged:
        return "None of the runs can be judged."
    bad = sum(severity == "bad" for severity in judged)
    return f"{bad} of {len(judged)} judged runs failed."


def _places(runs: Sequence[RunFiles]) -> tuple[list[str], bool]:
    """Name what each run is of, and say whether all are of one recording.

    Runs of one recording are known by its content: a scored trajectory does not say what it is of, and one recording
    may be named as a world, as a dataset and as a log.
    """
    names = [_place(run) for run in runs]
    with_data = [i for i, run in enumerate(runs) if run.truth is not None or run.odometry is not None]
    group = {i: next(j for j in with_data if j == i or same_data(runs[j], runs[i])) for i in with_data}
    for i, first in group.items():
        same = [names[k] for k in with_data if group[k] == first and names[k] != UNNAMED]
        if names[i] == UNNAMED and same:
            names[i] = same[0]
    return names, len(set(group.values())) == 1


def _place(run: RunFiles) -> str:
    """Name the world or the log that was mapped; a dash where the run does not say."""
    settings = run.config.get("settings", {})
    return _short(settings.get("world", settings.get("log", UNNAMED)))


def _short(value: Any) -> str:
    """Shorten a setting: keep the last part of a path."""
    text = str(value)
    return text.rstrip("/").rpartition("/")[2] if text.startswith("/") else text


def _result_row(
    measure: Measure, runs: Sequence[RunFiles], *, mark_best: bool
) -> tuple[str, list[tuple[str, bool]]] | None:
    """Label and, for each run, the figure and whether it is the best; None where no run has it.

    A run that failed is never the best: the error of a path that ends early is small.
    """
    values = [run.metric(measure.key) for run in runs]
    if all(value is None for value in values):
        return None
    texts = ["–" if value is None else measure.number_format.format(measure.factor * value) for value in values]
    in_race = [value is not None and _severity(run) != "bad" for value, run in zip(values, runs, strict=True)]
    known = [value for value, counts in zip(values, in_race, strict=True) if counts]
    if not (mark_best and measure.better != 0 and known and len(set(texts) - {"–"}) > 1):
        return measure.label, [(text, False) for text in texts]
    best = min(known) if measure.better < 0 else max(known)
    best_text = measure.number_format.format(measure.factor * best)
    return measure.label, [(text, counts and text == best_text) for text, counts in zip(texts, in_race, strict=True)]


def _differing_settings(runs: Sequence[RunFiles]) -> list[tuple[str, list[str]]]:
    """Settings of which two runs that have them differ, with each run's value."""
    tables = [dict(flat(run.config.get("settings", {}))) for run in runs]
    keys = sorted({key for table in tables for key in table} - {"world", "log"})
    rows = [(key, [_short(table[key]) if key in table else "–" for table in tables]) for key in keys]
    return [(key, values) for key, values in rows if len(set(values) - {"–"}) > 1]


def _curves(runs: Sequence[tuple[str, RunFiles]]) -> list[Plot]:
    """Plot the error over the distance travelled, for the runs with truth."""
    curves, longest = [], np.zeros(1)
    for index, (name, run) in enumerate(runs):
        if run.estimate is None or run.truth is None:
            continue
        try:
            matched = associate(run.estimate, run.truth)
        except AssociationError:
            continue
        path = matched.reference.distance
        curves.append((name, path, 100.0 * absolute_error(matched, "se2").translation_errors, colour_of(index)))
        longest = path if path[-1] > longest[-1] else longest
    if len(curves) < 2:
        return []
    at = np.linspace(0.0, longest[-1], 1000)
    series: list[plots.Series] = [
        (name, np.interp(at, path, error, right=np.nan), colour) for name, path, error, colour in curves
    ]
    source = plots.over_time(at, series, "error [cm]", axis="distance travelled [m]")
    return [Plot("Position error along the path", source, "Each run after SE(2) alignment of all its poses.")]


def _maps(runs: Sequence[tuple[str, RunFiles]]) -> list[Plot]:
    pictures = []
    for name, run in runs:
        if run.grid is None or not run.grid.known.any():
            continue
        T = _frame(run)
        picture = draw_map(run.grid, frame_around(run.grid, T, [], 0.5), T)
        pictures.append(Plot(name, picture.data_uri, str(run.metric("outcome")), True))
    return pictures


def _frame(run: RunFiles) -> Pose:
    """Return the truth's frame, so that maps of one world have one frame; else the map's own."""
    T: Any = run.metric("trajectory.T_truth_estimate")
    return np.zeros(3) if T is None else np.asarray(T, dtype=np.float64)
