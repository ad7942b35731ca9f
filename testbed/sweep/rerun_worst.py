# SPDX-License-Identifier: MIT
"""The worst runs of a sweep, carried out again with a recording and a report of their own.

Cells keep figures only; being pure functions, they can be looked at whenever somebody wants to.
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
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import RunSettings
from testbed.sweep.store import SweepDirectory
from testbed.views import Scene, ViewOptions, open_view


def is_recorded(directory: SweepDirectory, cell: Cell) -> bool:
    """Whether the run of a cell is there already."""
    return (_folder(directory, cell) / "report.html").is_file()


def record(directory: SweepDirectory, cell: Cell, watcher: RunProgress) -> bool:
    """Leave the run of a cell below `worst/` as `testbed run` does.

    Returns whether it came out as in the sweep, bit for bit: other processors may round differently.
    """
    folder = _folder(directory, cell)
    shutil.rmtree(folder, ignore_errors=True)
    job = replace(job_of(cell, recording_of(cell)), document=_document(cell), threads=None)
    run = RunDirectory.create(folder)
    scene = Scene(
        title=str(cell),
        settings=settings_as_markdown(job.document),
        particles=cell.particles,
        true_map=job.truth_map,
    )
    metrics = execute_job(job, run, watcher, open_view(run / "recording.rrd", scene, ViewOptions()))
    write_report(folder)
    swept = directory.result(cell.key)
    return swept is not None and metrics["result_hash"] == swept.metrics["result_hash"]


def _document(cell: Cell) -> dict[str, Any]:
    """Content of `config.toml`, with which `testbed run --config` or `testbed slam --config` repeats the run."""
    settings = RunSettings.of(cell.settings)
    estimator = EstimatorOptions(
        particles=cell.particles, seed=cell.seed, refine=settings.refine, filter=settings.filter
    )
    simulator = asdict(settings.simulator) if "world" in cell.source else {}
    return config_document({**cell.source, **simulator, **estimator.settings()}, map(Path, cell.inputs))


def _folder(directory: SweepDirectory, cell: Cell) -> Path:
    return directory.path / "worst" / cell.key
