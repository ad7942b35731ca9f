# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Estimate what a whole sweep costs from a random sample of its jobs, without carrying it out.

    python -m tools.measure.sweep_cost particles

Prints: core-minutes of all jobs of a preset or specification, with a 95 % interval (docs/sweep.md)

Jobs are drawn with a probability in proportion to their predicted work, with replacement, so the mean of (time / work),
times the work of all jobs, estimates their time without bias, however wrong the prediction is (Hansen, Hurwitz, "On the
theory of sampling from finite populations", Annals of Mathematical Statistics 14(4), 1943). Each drive is simulated
once in a sweep, so its simulation is estimated likewise, per drive. The time is that of the processor, which other work
on the machine disturbs little; start of the workers and report are not among it.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import stdtrit

from testbed.kernels import compile_kernels, is_compiled
from testbed.sweep.execution.compute import compute, drawn_recording
from testbed.sweep.execution.recordings import forget_recordings
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import Costs, by_recording, input_digests, plan
from testbed.sweep.spec.spec import SweepSpec, parse_spec, presets, read_document, read_preset


@dataclass(frozen=True)
class Total:
    """An estimated time [s] with its standard error."""

    seconds: float
    error: float


def estimated_total(seconds: Sequence[float], work: Sequence[float], whole: float) -> Total:
    """The time of all jobs from those that were drawn in proportion to their work.

    seconds and work: of the drawn jobs, (n,), n >= 2; whole: the work of all jobs
    """
    ratios = whole * np.asarray(seconds, np.float64) / np.asarray(work, np.float64)
    return Total(float(np.mean(ratios)), float(np.std(ratios, ddof=1)) / math.sqrt(len(ratios)))


def draw(cells: Sequence[Cell], costs: Costs, number: int, seed: int) -> list[Cell]:
    """Draw jobs with replacement, with a probability in proportion to their predicted work."""
    work = np.array([costs(cell) for cell in cells])
    rows = np.random.default_rng(seed).choice(len(cells), number, p=work / work.sum())
    return [cells[row] for row in sorted(rows)]


def measure(sample: Sequence[Cell]) -> tuple[list[float], list[float]]:
    """Processor time of the simulation of each job's drive [s], and of the job without it [s]."""
    compute(sample[0])  # loads the kernels
    simulation, jobs = [], []
    for number, cell in enumerate(sample, start=1):
        forget_recordings()
        started = time.process_time()
        drawn_recording(cell)
        ready = time.process_time()
        compute(cell)
        simulation.append(ready - started)
        jobs.append(time.process_time() - ready)
        print(f"{number} of {len(sample)}: {cell}: {jobs[-1]:.1f} s, its drive {simulation[-1]:.1f} s", flush=True)
    return simulation, jobs


def specification(name: str) -> SweepSpec:
    """A preset, or the specification in a TOML file."""
    if name in presets():
        return parse_spec(read_preset(name), f"preset {name}", Path())
    return parse_spec(read_document(Path(name)), name, Path(name).parent)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("spec", help="preset or TOML file of a sweep")
    parser.add_argument("--jobs", type=int, default=30, help="how many are computed, at least 2; default: 30")
    parser.add_argument("--seed", type=int, default=0, help="of the sample; default: 0")
    arguments = parser.parse_args()
    if not is_compiled():
        compile_kernels()
    spec = specification(arguments.spec)
    cells, costs = plan(spec, code_version(), input_digests(spec)), Costs.of(spec)
    sample = draw(cells, costs, max(arguments.jobs, 2), arguments.seed)
    simulation, jobs = measure(sample)
    of_jobs = estimated_total(jobs, [costs(cell) for cell in sample], sum(map(costs, cells)))
    drives = [group[0] for group in by_recording(cells)]
    of_drives = estimated_total(simulation, [costs.length(c) for c in sample], sum(map(costs.length, drives)))
    minutes = (of_jobs.seconds + of_drives.seconds) / 60.0
    half = float(stdtrit(len(sample) - 1, 0.975)) * math.hypot(of_jobs.error, of_drives.error) / 60.0
    print(
        f"{len(cells)} jobs: {minutes:.0f} minutes of one core (95 % interval {minutes - half:.0f} to "
        f"{minutes + half:.0f}), of them {of_drives.seconds / 60.0:.1f} to simulate {len(drives)} drives; "
        f"from {len(sample)} jobs"
    )


if __name__ == "__main__":
    main()
