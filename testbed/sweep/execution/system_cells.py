# SPDX-License-Identifier: MIT
"""The SLAM system of a cell (`testbed.systems`), and cells with one that no run can follow scan by scan."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from eval.scoring import Reference
from testbed.run.followed import Followed
from testbed.sweep.execution.recordings import Recording
from testbed.sweep.result import MEASURED, CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import RunSettings
from testbed.systems.entrant import ClassEntrant, Entrant, PythonSystem, entrant_of, filter_settings
from testbed.systems.execute import Recorded, metrics_of_system
from testbed.systems.finding import DEFAULT

COSTS = ("cpu_s", "ms_per_scan", "ms_per_scan_p95", "finish_s", "memory_mb")
"""What differs from run to run in the group `system`; `wall_s` is among `MEASURED`."""


def entrant_of_cell(cell: Cell, threads: int | None = 1) -> Entrant:
    """The system of a cell, with the cell's settings; threads: of this package's filter, None = all cores."""
    settings = RunSettings.of(cell.settings)
    entrant = entrant_of(settings.system or DEFAULT, settings.system_format)
    if not isinstance(entrant, PythonSystem):
        return entrant
    config = replace(settings.filter, particles=cell.particles)
    own = filter_settings(entrant.text, config, refine=settings.refine, threads=threads)
    return replace(entrant, settings=own)


def followed_of(entrant: Entrant) -> Followed | None:
    """A new instance of a system that a run can follow; None for other systems."""
    system = entrant.make() if isinstance(entrant, ClassEntrant) else None
    return system if isinstance(system, Followed) else None


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
    timing = {name: metrics.pop(name, None) for name in MEASURED}
    timing |= {"cpu_s": cost.cpu_s, "cell_s": time.perf_counter() - started}
    del timing["peak_rss_mb"]  # this process has computed other cells, whose memory would count too
    return CellResult(metrics, {"share": [], "ess": [], "unique_ancestors": [], "nees": []}, timing)
