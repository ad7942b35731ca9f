# SPDX-License-Identifier: MIT
"""Repeats the worst runs of a sweep with a recording and a report each.

A sweep keeps only the figures of its cells. A cell is a pure function of its settings, so its run can be repeated.
"""

from __future__ import annotations

import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from eval.report.run_report import write_report
from testbed.provenance import config_document, settings_as_markdown
from testbed.run.execute import RunProgress, execute_job
from testbed.run.run_directory import RunDirectory
from testbed.settings.estimator import EstimatorOptions
from testbed.sweep.execution.compute import job_of
from testbed.sweep.execution.recordings import recording_of
from testbed.sweep.execution.system_cells import entrant_of_cell, followed_of, recorded_of
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import RunSettings
from testbed.sweep.store import SweepDirectory
from testbed.systems.entrant import Entrant
from testbed.systems.execute import execute_system
from testbed.views import Scene, ViewOptions, moments_for_report, open_view


def is_recorded(directory: SweepDirectory, cell: Cell) -> bool:
    """Whether the run of this cell was already repeated."""
    return (_folder(directory, cell) / "report.html").is_file()


def rerun(directory: SweepDirectory, cell: Cell, watcher: RunProgress) -> bool:
    """Repeat the run of a cell below `worst/`, with all files that `testbed run` writes.

    Returns whether the result equals that of the sweep bit for bit; processors of another kind may round differently.
    """
    folder = _folder(directory, cell)
    shutil.rmtree(folder, ignore_errors=True)
    entrant = entrant_of_cell(cell, threads=None)
    system = followed_of(entrant)
    if system is None:
        return _rerun_system(directory, cell, entrant, folder)
    job = replace(job_of(cell, recording_of(cell), system), document=_document(cell))
    run = RunDirectory.create(folder)
    scene = Scene(
        title=str(cell),
        settings=settings_as_markdown(job.document),
        particles=cell.particles,
        true_map=job.truth_map,
    )
    metrics = execute_job(job, run, watcher, open_view(run / "recording.rrd", scene, ViewOptions()))
    write_report(folder, moments_for_report(folder))
    swept = directory.result(cell.key)
    return swept is not None and metrics["result_hash"] == swept.metrics["result_hash"]


def _rerun_system(directory: SweepDirectory, cell: Cell, system: Entrant, folder: Path) -> bool:
    """Repeat the run of a cell with another SLAM system, which leaves no recording."""
    recorded = recorded_of(cell, recording_of(cell))
    metrics, _ = execute_system(system, recorded, RunDirectory.create(folder), _document(cell))
    write_report(folder)
    swept = directory.result(cell.key)
    return swept is not None and metrics["trajectory"] == swept.metrics["trajectory"]


def _document(cell: Cell) -> dict[str, Any]:
    """Content of `config.toml`: `testbed run --config` or `testbed slam --config` repeats the run with it."""
    settings = RunSettings.of(cell.settings)
    estimator = EstimatorOptions(
        particles=cell.particles, seed=cell.seed, refine=settings.refine, filter=settings.filter
    )
    simulator = asdict(settings.simulator) if "world" in cell.source else {}
    system = {"system": settings.system} if settings.system else {}
    return config_document({**cell.source, **simulator, **estimator.settings(), **system}, map(Path, cell.inputs))


def _folder(directory: SweepDirectory, cell: Cell) -> Path:
    return directory.path / "worst" / cell.key
