# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure which share of a whole sweep of many small jobs is the filter, by the command that users enter.

    python -m tools.measure.sweep_overhead

Prints: shares of filter and final pass, of simulation and scoring, and of all else (docs/sweep.md)

All else is the forecast, the start of the workers, waiting for them, tables and report. `--seeds` and `--duration` make
the sweep smaller.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq

from testbed.kernels import compile_kernels, is_compiled

PARTICLES = "5,6,7,8,9,10,11,12,13,14"
TESTBED = (sys.executable, "-c", "from testbed.cli import main; main()")


@dataclass(frozen=True)
class Shares:
    """Shares of the time of all workers from the start of the command to its end, of sum 1."""

    jobs: int
    """Number of jobs."""
    seconds: float
    """Mean time of a job [s]."""
    filter: float
    """Filter and final pass."""
    in_jobs: float
    """Simulation, scoring and all else in the jobs."""
    outside: float
    """Everything outside of the jobs."""

    @property
    def overhead(self) -> float:
        """All that is not filter and final pass."""
        return self.in_jobs + self.outside


def measure(out: Path, *, seeds: int = 20, duration: float | None = None, workers: int = 2) -> Shares:
    """Carry out a sweep of the apartment in a process of its own; the kernels must be compiled.

    duration: simulated time of each drive [s]; None = the whole tour.
    """
    command = [*TESTBED, "sweep", "--worlds", "apartment", "--particles", PARTICLES]
    command += ["--seeds", str(seeds), "--refine", "none", "--workers", str(workers), "--out", str(out)]
    command += [] if duration is None else ["--set", f"duration={duration}"]
    started = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    whole = workers * (time.perf_counter() - started)
    timings = pq.read_table(out / "timings.parquet")
    own, jobs = (sum(timings.column(name).to_pylist()) for name in ("wall_s", "cell_s"))
    count = timings.num_rows
    return Shares(count, jobs / count, own / whole, (jobs - own) / whole, 1.0 - jobs / whole)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="ten jobs each; default: 20")
    parser.add_argument("--duration", type=float, help="simulated time of each drive [s]; default: the whole tour")
    arguments = parser.parse_args()
    if not is_compiled():
        compile_kernels()
    with tempfile.TemporaryDirectory() as folder:
        shares = measure(Path(folder) / "sweep", seeds=arguments.seeds, duration=arguments.duration)
    print(
        f"{shares.jobs} jobs of {shares.seconds:.1f} s with two workers: filter and final pass {shares.filter:.1%}, "
        f"simulation and scoring {shares.in_jobs:.1%}, all else {shares.outside:.1%}; overhead {shares.overhead:.1%}"
    )


if __name__ == "__main__":
    main()
