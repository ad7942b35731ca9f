# SPDX-License-Identifier: MIT
"""Computes one cell: a pure function of the cell, whichever way the sweep is executed."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from eval.filter.nees import nees
from eval.filter.step_table import column, updates
from testbed.run.execute import metrics_of
from testbed.run.followed import Followed
from testbed.run.job import Job
from testbed.sweep.errors import SweepError
from testbed.sweep.execution.recordings import Recording, recording_of
from testbed.sweep.execution.system_cells import compute_system, entrant_of_cell, followed_of
from testbed.sweep.result import MEASURED, CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import file_digest
from testbed.sweep.spec.settings import RunSettings

CURVE_POINTS = 50
"""Number of points of the curves of a cell."""


def compute(cell: Cell) -> CellResult:
    """Map and score. Raises SweepError if code or input files differ from those that the cell was planned with."""
    started = time.perf_counter()
    check_inputs(cell)
    recording = recording_of(cell)
    entrant = entrant_of_cell(cell)
    system = followed_of(entrant)
    if system is None:
        return compute_system(cell, entrant, recording, started)
    # both would take more time than all other scoring, and the truth is known
    job = replace(job_of(cell, recording, system), aligns_map=False, checks_by_replay=False)
    began, cpu_began = time.perf_counter(), time.process_time()
    system.start((), job.seed)
    for frame in job.source:
        system.process(frame)
    estimation = system.following()
    filtered = estimation.filtered()
    estimate = estimation.refined(filtered) if system.refines else filtered
    wall, cpu = time.perf_counter() - began, time.process_time() - cpu_began
    metrics = metrics_of(job, filtered, estimate, wall_seconds=wall, ended=job.source.ended)
    metrics["features"] = recording.features
    timing = {name: metrics.pop(name, None) for name in MEASURED}
    timing |= {"cpu_s": cpu, "cell_s": time.perf_counter() - started}
    del timing["peak_rss_mb"]  # this process has computed other cells, whose memory would count too
    return CellResult(metrics, _curves(estimation.steps.columns()), timing)


def drawn_recording(cell: Cell) -> Recording:
    """Return the recording of a cell with its true map, both of which are kept for the next cell of the same drive."""
    recording = recording_of(cell)
    recording.truth_map(RunSettings.of(cell.settings).filter.map.cell)
    return recording


def job_of(cell: Cell, recording: Recording, system: Followed) -> Job:
    """The job that `testbed run` or `testbed slam` would execute with the settings of the cell, and its system."""
    settings = RunSettings.of(cell.settings)
    truth = recording.truth_map(settings.filter.map.cell)
    return Job(
        source=recording.source,
        document={},
        seed=cell.seed,
        system=system,
        truth_map=truth.grid,
        truth_walls=truth.walls,
        lidars=recording.lidars,
        observable=truth.observable,
        relations=recording.relations,
    )


def check_inputs(cell: Cell) -> None:
    """Raise SweepError if code or input files differ from those that the cell was planned with."""
    if code_version() != cell.code:
        raise SweepError(f"code version {code_version()} here, {cell.code} in the plan: expected the same installation")
    for path, digest in cell.inputs.items():
        if file_digest(path) != digest:
            raise SweepError(f"{path}: has changed since the sweep was planned")


def _curves(steps: dict[str, Any]) -> dict[str, list[float | None]]:
    """Mean over equal parts of the updates; None if no value is known."""
    rows = np.flatnonzero(updates(steps))
    judged, values, _ = nees(steps)
    error = np.full(len(column(steps, "stamp")), np.nan)
    error[judged] = values
    particles = column(steps, "particles")
    parts = np.array_split(rows, min(CURVE_POINTS, len(rows)))
    curves = {
        "ess": column(steps, "ess") / particles,
        "unique_ancestors": column(steps, "unique_ancestors") / particles,
        "nees": error,
    }
    share: list[float | None] = [(k + 1) / len(parts) for k in range(len(parts))]
    return {"share": share} | {name: [_mean(values[part]) for part in parts] for name, values in curves.items()}


def _mean(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None
