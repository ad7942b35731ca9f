# SPDX-License-Identifier: MIT
"""Cells whose frames are processed by another SLAM system than the filter of this package (`testbed.systems`)."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from eval.scoring import Reference
from testbed.sweep.execution.recordings import Recording
from testbed.sweep.result import MEASURED, CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import RunSettings
from testbed.systems.entrant import Entrant, PythonSystem, entrant_of
from testbed.systems.execute import Recorded, metrics_of_system

FILTER = "gmapping"
"""The system that cells have without the setting `system`: the filter of this package."""
COSTS = ("cpu_s", "ms_per_scan", "ms_per_scan_p95", "finish_s", "memory_mb")
"""What differs from run to run in the group `system`; `wall_s` is among `MEASURED`."""


def system_of(cell: Cell) -> Entrant | None:
    """The system of a cell, with the cell's settings; None for the filter of this package."""
    settings = RunSettings.of(cell.settings)
    if settings.system in ("", FILTER):
        return None
    entrant = entrant_of(settings.system, settings.system_format)
    if isinstance(entrant, PythonSystem) and entrant.text in ("scan-matching", "localization"):
        config = replace(settings.filter, particles=cell.particles)
        return replace(entrant, settings={"filter": config, "threads": 1})
    return entrant


def recorded_of(cell: Cell, recording: Recording) -> Recorded:
    """What the system of a cell sees, and what it is scored by."""
    truth = recording.truth_map(RunSettings.of(cell.settings).filter.map.cell)
    reference = Reference(
        relations=recording.relations,
        grid=truth.grid,
        walls=truth.walls,
        lidars=recording.lidars,
        observable=truth.observable,
        aligns_map=False,  # it would take most of the time of scoring
    )
    return Recorded.of(recording.source.frames, cell.seed, reference, recording.source.ended)


def compute_system(cell: Cell, entrant: Entrant, recording: Recording, started: float) -> CellResult:
    """Run a system on the recording of a cell and score it; SystemFailedError makes the cell a failed one.

    started: `time.perf_counter()` when the cell was begun [s]
    """
    recorded = recorded_of(cell, recording)
    estimated, cost = entrant.run(recorded.frames, recorded.seed)
    metrics: dict[str, Any] = metrics_of_system(entrant.facts(), recorded, estimated, cost)
    metrics["features"] = recording.features
    metrics["particles"] = cell.particles
    for name in ("wall_s", *COSTS):
        metrics["system"].pop(name)
    timing = {name: metrics.pop(name, None) for name in MEASURED} | {"cell_s": time.perf_counter() - started}
    del timing["peak_rss_mb"]  # this process has computed other cells, whose memory would count too
    return CellResult(metrics, {"share": [], "ess": [], "unique_ancestors": [], "nees": []}, timing)
