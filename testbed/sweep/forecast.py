# SPDX-License-Identifier: MIT
"""How long a sweep will take: from the times of its finished jobs, else from the beginning of a few of its runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

import numpy as np

from eval.sweep.job_times import REPORT_SECONDS
from eval.sweep.results import SweepTable
from testbed.sweep.execution.compute import compute, drawn_recording
from testbed.sweep.execution.worker_process import CellFailedError, Limits, WorkerProcess
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import Costs, by_recording

FIRST_DURATION = 1.0
"""Simulated time of the run that loads the kernels [s]."""
BRIEF_DURATION = 2.0
"""Simulated time of runs that show what the world takes rather than the way: its true map is drawn, its features are
found, and the map is scored, which takes long in a large world however far the robot drives [s]."""
PROBE_DURATION = (10.0, 40.0)
"""Shortest and longest simulated time of the runs that are measured [s]: in the longest the robot drives straight and
turns; a small sweep is measured by shorter ones, since measuring is no work on its jobs."""
LONG_COST = 100_000.0
"""Sweeps that cost as much as this, about five minutes of one core, are measured by the longest runs."""
PROBE_PARTICLES = (2, 12)
"""Particles of these runs: their difference is what particles cost."""
MAX_PROBED = 3
"""So many lidars are measured; further ones are taken to cost as much as the first."""
MIN_COST = 5_000.0
"""Sweeps that cost less than this take some seconds; measuring them would take as long."""


@dataclass(frozen=True, eq=False)
class JobTimes:
    """Expected time of each job of one core."""

    seconds_of: Callable[[Cell], float]
    """Time of a job [s], with its share of the simulation of its drive."""
    source: str
    """Where the times come from, in words."""

    def total(self, cells: Sequence[Cell], workers: int) -> float:
        """Time until the report is there [s], if all workers are busy to the end."""
        return sum(map(self.seconds_of, cells)) / workers + REPORT_SECONDS


def measured_times(table: SweepTable, cells: Sequence[Cell], costs: Costs) -> JobTimes | None:
    """Times of the jobs of these cells by those that are done, by world, line and count; None if none is done.

    Groups without a finished job are taken to need as much time for their predicted work as the others.
    """
    seconds = table.cube("cell_s")
    done = np.isfinite(seconds)
    means = {
        (table.places[p], table.lines[k], table.counts[c]): float(np.mean(seconds[p, k, c][done[p, k, c]]))
        for p, k, c in np.argwhere(done.any(axis=-1))
    }
    measured = [cell for cell in cells if (cell.place, cell.line, cell.particles) in means]
    if not measured:
        return None
    work = sum(map(costs, measured))
    rate = sum(means[cell.place, cell.line, cell.particles] for cell in measured) / work

    def seconds_of(cell: Cell) -> float:
        known = means.get((cell.place, cell.line, cell.particles))
        return rate * costs(cell) if known is None else known

    return JobTimes(seconds_of, "from the jobs that are done")


@dataclass(frozen=True)
class Pace:
    """Time of one core for drives and jobs, whatever their length [s], and per metre driven [s/m]."""

    drive: float
    """Of a drive, whatever its length [s]."""
    job: float
    """Of a job, whatever its length and particle count [s]."""
    simulation: float
    """Of simulating, once per drive."""
    fixed: float
    """Of a job, whatever its particle count."""
    particle: float
    """Of a job, for each particle."""
    final_pass: float
    """Of the final pass."""


def probed_times(cells: Sequence[Cell], costs: Costs, workers: int) -> JobTimes | None:
    """Times of these jobs by the beginning of some, see `measure_pace`; None where nothing is measured."""
    paces = measure_pace(cells, costs, workers)
    if paces is None:
        return None
    usual = next(iter(paces.values()))
    jobs_of_drive = {group[0].place: len(group) for group in by_recording(cells)}

    def seconds_of(cell: Cell) -> float:
        pace = paces.get(lidar_of(cell), usual)
        final_pass = pace.final_pass if cell.settings.get("refine", True) else 0.0
        length, per_metre = costs.length(cell), pace.fixed + pace.particle * Costs.filter_work(cell) + final_pass
        drive = pace.drive + length * pace.simulation
        return drive / jobs_of_drive.get(cell.place, 1) + pace.job + length * per_metre

    return JobTimes(seconds_of, "estimated from the beginning of a run")


def measure_pace(cells: Sequence[Cell], costs: Costs, workers: int) -> dict[str, Pace] | None:
    """Measure how fast runs with each lidar are, by computing the beginning of some in the longest world.

    While one process is measured the other workers compute too, since they share the memory and the cores of the
    machine. The result has the pace by lidar; None if there is nothing to simulate, or if the sweep takes seconds only.
    """
    simulated = [cell for cell in cells if "world" in cell.source]
    if not simulated or sum(map(costs, cells)) < MIN_COST:
        return None
    longest = max(simulated, key=costs.length).place
    of_lidar = {lidar_of(cell): cell for cell in reversed(simulated) if cell.place == longest}
    probed = list(of_lidar)[:MAX_PROBED]
    refined = any(cell.settings.get("refine", True) for cell in simulated)
    shortest, longest_run = PROBE_DURATION
    duration = min(max(shortest, longest_run * sum(map(costs, cells)) / LONG_COST), longest_run)
    with _busy(workers - 1, _probe(of_lidar[probed[0]], duration, PROBE_PARTICLES[1], refine=False)):
        _timed(of_lidar[probed[0]], FIRST_DURATION, PROBE_PARTICLES[0])
        return {lidar: _pace(of_lidar[lidar], duration, refined=refined) for lidar in probed}


@contextmanager
def _busy(number: int, cell: Cell) -> Iterator[None]:
    """Let so many worker processes compute a cell again and again while the block runs."""
    workers = [WorkerProcess(Limits()) for _ in range(number)]

    def compute_on(worker: WorkerProcess) -> None:
        with suppress(CellFailedError):  # stopping the worker ends its last computation
            while True:
                worker.compute(cell)

    with ThreadPoolExecutor(max(number, 1)) as threads:
        for worker in workers:
            threads.submit(compute_on, worker)
        try:
            yield
        finally:
            for worker in workers:
                worker.stop()


def lidar_of(cell: Cell) -> str:
    """The lidar of a cell; empty for the default."""
    return str(cell.settings.get("lidar", ""))


def _pace(cell: Cell, duration: float, *, refined: bool) -> Pace:
    """The pace of runs like a cell, from a brief and a longer one: what both take is that of the world."""
    few, many = PROBE_PARTICLES
    brief_drive, whole_drive = (_simulated(cell, seconds) for seconds in (BRIEF_DURATION, duration))
    brief, start = _timed(cell, BRIEF_DURATION, few)  # the drives are there already
    smaller, length = _timed(cell, duration, few)
    larger, _ = _timed(cell, duration, many)
    way = max(length - start, 0.1)
    simulation, per_metre = max(whole_drive - brief_drive, 0.0) / way, max(smaller - brief, 0.0) / way
    particle = max(larger - smaller, 0.0) / (many - few) / length
    with_final_pass = _timed(cell, duration, few, refine=True)[0] if refined else smaller
    return Pace(
        drive=max(brief_drive - start * simulation, 0.0),
        job=max(brief - start * per_metre, 0.0),
        simulation=simulation,
        fixed=max(per_metre - few * particle, 0.0),
        particle=particle,
        final_pass=max(with_final_pass - smaller, 0.0) / length,
    )


def _simulated(cell: Cell, duration: float) -> float:
    """Time in which the first seconds of a drive are simulated, with the true map that is kept with it [s]."""
    started = time.perf_counter()
    probe = _probe(cell, duration, PROBE_PARTICLES[0], refine=False)
    drawn_recording(probe)
    return time.perf_counter() - started


def _timed(cell: Cell, duration: float, particles: int, *, refine: bool = False) -> tuple[float, float]:
    """Time [s] and length of the drive [m] of the first seconds of a run."""
    probe = _probe(cell, duration, particles, refine=refine)
    started = time.perf_counter()
    metrics = compute(probe).metrics
    return time.perf_counter() - started, max(float(metrics["trajectory"]["length_m"]), 0.1)


def _probe(cell: Cell, duration: float, particles: int, *, refine: bool) -> Cell:
    """The first seconds of a run as a cell."""
    duration = min(duration, float(cell.settings.get("duration", duration)))
    return replace(cell, settings={**cell.settings, "duration": duration, "refine": refine}, particles=particles)
