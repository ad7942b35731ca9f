# SPDX-License-Identifier: MIT
"""How long a sweep will take, from the beginning of one of its runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from testbed.sweep.execution.compute import compute
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import Costs

PROBES = (2.0, 2.0, 15.0)
"""Simulated time of the short runs [s]: the first loads the kernels; the difference of the others is measured, so that
what does not depend on the length of a run drops out."""
PROBE_PARTICLES = 5
"""Particles of the short runs."""
MIN_COST = 500.0
"""Sweeps that cost less than this take seconds; measuring them would take as long."""
REPORT_SECONDS = 8.0
"""Typical time for tables and report [s]."""


def measure_pace(cells: Sequence[Cell], costs: Costs) -> float | None:
    """Seconds of one core per unit of `costs`, measured by computing the beginning of one run.

    None if there is nothing to simulate, or if the sweep is so small that it takes seconds.
    """
    cell = next((cell for cell in cells if "world" in cell.source), None)
    if cell is None or sum(map(costs, cells)) < MIN_COST:
        return None
    probes = [_probe(cell, duration, costs) for duration in PROBES]
    (short, short_cost), (long, long_cost) = probes[1:]
    return (long - short) / (long_cost - short_cost) if long > short and long_cost > short_cost else None


def _probe(cell: Cell, duration: float, costs: Costs) -> tuple[float, float]:
    """Time [s] and cost of the first seconds of a run."""
    shortened = {**cell.settings, "duration": duration, "refine": False}
    probe = replace(cell, settings=shortened, particles=PROBE_PARTICLES)
    started = time.perf_counter()
    metrics = compute(probe).metrics
    return time.perf_counter() - started, costs.of_length(float(metrics["trajectory"]["length_m"]), probe)


def expected_seconds(cells: Sequence[Cell], costs: Costs, pace: float, workers: int) -> float:
    """Time until the report is there [s], if all workers are busy to the end."""
    return pace * sum(map(costs, cells)) / workers + REPORT_SECONDS
