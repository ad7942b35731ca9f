# SPDX-License-Identifier: MIT
"""How long a sweep will take, from the beginning of a few of its runs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from testbed.sweep.execution.compute import compute
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import Costs, by_recording

FIRST_DURATION = 2.0
"""Simulated time of the run that loads the kernels [s]."""
PROBE_DURATION = 40.0
"""Simulated time of the runs that are measured [s]: long enough for the robot to drive straight and to turn."""
PROBE_PARTICLES = (2, 12)
"""Particles of these runs: their difference is what particles cost."""
MAX_PROBED = 3
"""So many lidars are measured; further ones are taken to cost as much as the first."""
MIN_COST = 500.0
"""Sweeps that cost less than this take seconds; measuring them would take as long."""
REPORT_SECONDS = 8.0
"""Typical time to start the workers and to make tables and report [s]."""


@dataclass(frozen=True)
class Pace:
    """Time of one core per metre driven [s/m]."""

    simulation: float
    """Of simulating, once per drive."""
    fixed: float
    """Of a job, whatever its particle count."""
    particle: float
    """Of a job, for each particle."""
    final_pass: float
    """Of the final pass."""


def measure_pace(cells: Sequence[Cell], costs: Costs) -> dict[str, Pace] | None:
    """Measure how fast runs with each lidar are, by computing the beginning of some in the longest world.

    The result has the pace by lidar; None if there is nothing to simulate, or if the sweep takes seconds only.
    """
    simulated = [cell for cell in cells if "world" in cell.source]
    if not simulated or sum(map(costs, cells)) < MIN_COST:
        return None
    longest = max(simulated, key=costs.length).place
    of_lidar = {lidar_of(cell): cell for cell in reversed(simulated) if cell.place == longest}
    probed = list(of_lidar)[:MAX_PROBED]
    _timed(of_lidar[probed[0]], FIRST_DURATION, PROBE_PARTICLES[0])
    refined = any(cell.settings.get("refine", True) for cell in simulated)
    return {lidar: _pace(of_lidar[lidar], refined=refined) for lidar in probed}


def lidar_of(cell: Cell) -> str:
    """The lidar of a cell; empty for the default."""
    return str(cell.settings.get("lidar", ""))


def _pace(cell: Cell, *, refined: bool) -> Pace:
    few, many = PROBE_PARTICLES
    first, length = _timed(cell, PROBE_DURATION, few)
    again, _ = _timed(cell, PROBE_DURATION, few)  # its drive is there already
    larger, _ = _timed(cell, PROBE_DURATION, many)
    particle = max(larger - again, 0.0) / (many - few)
    with_final_pass = _timed(cell, PROBE_DURATION, few, refine=True)[0] if refined else again
    return Pace(
        simulation=max(first - again, 0.0) / length,
        fixed=max(again - few * particle, 0.0) / length,
        particle=particle / length,
        final_pass=max(with_final_pass - again, 0.0) / length,
    )


def _timed(cell: Cell, duration: float, particles: int, *, refine: bool = False) -> tuple[float, float]:
    """Time [s] and length of the drive [m] of the first seconds of a run."""
    duration = min(duration, float(cell.settings.get("duration", duration)))
    probe = replace(cell, settings={**cell.settings, "duration": duration, "refine": refine}, particles=particles)
    started = time.perf_counter()
    metrics = compute(probe).metrics
    return time.perf_counter() - started, max(float(metrics["trajectory"]["length_m"]), 0.1)


def _per_metre(pace: Pace, cell: Cell) -> float:
    final_pass = pace.final_pass if cell.settings.get("refine", True) else 0.0
    return pace.fixed + pace.particle * Costs.filter_work(cell) + final_pass


def expected_seconds(cells: Sequence[Cell], costs: Costs, paces: Mapping[str, Pace], workers: int) -> float:
    """Time until the report is there [s], if all workers are busy to the end."""
    usual = next(iter(paces.values()))
    total = 0.0
    for group in by_recording(cells):
        pace = paces.get(lidar_of(group[0]), usual)
        length = costs.length(group[0])
        total += length * pace.simulation
        total += sum(length * _per_metre(pace, cell) for cell in group)
    return total / workers + REPORT_SECONDS
