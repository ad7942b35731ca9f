# SPDX-License-Identifier: MIT
"""Carrying out one cell: a pure function of the cell, on every way of running a sweep the same."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eval.filter.nees import nees
from eval.filter.step_table import column, updates
from testbed.run.estimation import Estimation
from testbed.run.execute import Job, metrics_of
from testbed.seeds import streams
from testbed.sweep.errors import SweepError
from testbed.sweep.execution.recordings import Recording, recording_of
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import file_digest
from testbed.sweep.spec.settings import RunSettings

MEASURED = ("wall_s", "peak_rss_mb", "realtime_factor", "filter_s", "us_per_update_per_particle")
"""Measures that differ from run to run: kept apart, so that all else can be compared byte for byte."""
CURVE_POINTS = 50
"""Rows of the curves of a cell."""


@dataclass(frozen=True)
class CellResult:
    """What came of a cell, as plain data for JSON."""

    metrics: dict[str, Any]
    """As in `metrics.json` of a run, without `MEASURED`."""
    curves: dict[str, list[float | None]]
    """Health of the filter along the run, columns of equal length: `share` of the updates done, in (0, 1]; `ess`,
    effective sample size and `founders`, unique ancestors, as shares of the particles; `nees`."""
    timing: dict[str, float | None]
    """`MEASURED` but the memory, and `cell_s`, all that the cell took [s]."""


def compute(cell: Cell) -> CellResult:
    """Map and score. Raises SweepError where code or input files are not those that the cell was planned with."""
    started = time.perf_counter()
    check_inputs(cell)
    recording = recording_of(cell)
    job = job_of(cell, recording)
    began = time.perf_counter()
    estimation = Estimation(job.filter, job.filter_seed, job.threads)
    for frame in job.frames:
        estimation.process(frame)
    filtered = estimation.filtered()
    estimate = estimation.refined(filtered) if job.refine else filtered
    metrics = metrics_of(job, estimation, estimate, time.perf_counter() - began, job.ended())
    timing = {name: metrics.pop(name, None) for name in MEASURED} | {"cell_s": time.perf_counter() - started}
    del timing["peak_rss_mb"]  # the process has computed other cells before
    return CellResult(metrics, _curves(estimation.steps.columns()), timing)


def job_of(cell: Cell, recording: Recording) -> Job:
    """The job of `testbed run` or `testbed slam` with the settings of the cell; without a document, to be measured."""
    settings = RunSettings.of(cell.settings)
    return Job(
        frames=recording.frames,
        document={},
        seed=cell.seed,
        filter=replace(settings.filter, particles=cell.particles),
        filter_seed=streams(cell.seed).filter,
        threads=1,
        refine=settings.refine,
        truth_map=recording.truth_map(settings.filter.map.cell),
        relations=recording.relations,
        ended=lambda: recording.ended,
    )


def check_inputs(cell: Cell) -> None:
    """Raise SweepError where code or input files are not those that the cell was planned with."""
    if code_version() != cell.code:
        raise SweepError(f"code version {code_version()} here, {cell.code} in the plan: expected the same installation")
    for path, digest in cell.inputs.items():
        if file_digest(path) != digest:
            raise SweepError(f"{path}: has changed since the sweep was planned")


def _curves(steps: dict[str, Any]) -> dict[str, list[float | None]]:
    """Mean over equal parts of the updates; None where nothing is known."""
    rows = np.flatnonzero(updates(steps))
    judged, values, _ = nees(steps)
    error = np.full(len(column(steps, "stamp")), np.nan)
    error[judged] = values
    particles = column(steps, "particles")
    parts = np.array_split(rows, min(CURVE_POINTS, len(rows)))
    curves = {
        "ess": column(steps, "ess") / particles,
        "founders": column(steps, "unique_ancestors") / particles,
        "nees": error,
    }
    share: list[float | None] = [(k + 1) / len(parts) for k in range(len(parts))]
    return {"share": share} | {name: [_mean(values[part]) for part in parts] for name, values in curves.items()}


def _mean(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None
