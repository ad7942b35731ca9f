# SPDX-License-Identifier: MIT
"""Measure the accuracy in all worlds of the catalogue.

    python -m tools.measure.measure_worlds RUNS [--seeds 10] [--workers 2] [--no-run]

Writes: docs/accuracy.md (worlds)

Default robot, lidar, odometry and filter, 30 particles, final pass, backend `fast`. The runs are those of a `testbed
sweep`, which continues where it was stopped. A run takes one to three minutes of one core. --no-run computes nothing
and writes the table from the runs in RUNS.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.sweep.results import SweepTable, read_sweep
from eval.sweep.statistics import wilson_interval
from tools.pages import DOCS, write_table
from worlds import catalogue

PARTICLES = 30
OPEN = ("courtyard", "hall", "long_corridor")
"""Worlds with stretches in which the lidar cannot measure how far the robot has driven."""


LARGE = ("campus", "park")
"""Worlds in which a run takes many minutes; docs/accuracy.md has the command for them."""


def carry_out(runs: Path, seeds: int, workers: int) -> None:
    """Compute the missing runs with the command line, as a reader would."""
    testbed = str(Path(sys.executable).with_name("testbed"))
    options = {
        "worlds": ",".join(sorted(set(catalogue()) - set(LARGE))),
        "particles": PARTICLES,
        "seeds": seeds,
        "workers": workers,
    }
    flags = [f"--{name}={value}" for name, value in options.items()]
    subprocess.run([testbed, "sweep", *flags, "--no-worst", "--out", str(runs)], check=True)


def failed(table: SweepTable) -> NDArray[np.bool_]:
    """Runs that ended with another outcome than `ok` (so `drift` too), in the shape of the table's cubes."""
    bad: NDArray[np.bool_] = table.ran & (table.columns["outcome"].astype(str) != "ok")
    return bad


def row(name: str, table: SweepTable, places: list[int]) -> str:
    """One line of the table; several places are pooled."""
    errors = table.error[places].ravel()
    done = np.isfinite(errors)
    runs, failures = int(table.ran[places].sum()), int(failed(table)[places].sum())
    median, worst = (f"{100.0 * f(errors[done]):.1f} cm" for f in (np.median, np.max))
    heading = float(np.median(table.cube("trajectory.heading_rmse_deg")[places].ravel()[done]))
    odometry = float(np.median(table.cube("trajectory.odometry.ate_rmse_m")[places].ravel()[done]))
    nees = float(np.median(table.cube("filter.consistency.nees_mean")[places].ravel()[done]))
    within, thickness, truly = (
        float(np.nanmedian(table.cube(f"map.{measure}")[places]))
        for measure in ("iou_1_cells", "wall_thickness_m", "true_wall_thickness_m")
    )
    cells = [name, f"{runs}", median, worst, f"{failures}", f"{heading:.2f}°", f"{odometry:.2f} m", f"{nees:.0f}"]
    cells += [f"{within:.2f}", f"{100.0 * thickness:.1f} cm, {100.0 * truly:.1f} cm"]
    return "| " + " | ".join(cells) + " |"


def text(table: SweepTable) -> str:
    """The table, with one line that pools all worlds except the open ones."""
    known = [place for place, name in enumerate(table.places) if table.ran[place].any()]
    closed = [place for place in known if table.places[place] not in OPEN]
    head = ["world", "runs", "ATE, median", "worst", "not `ok`", "heading", "odometry's ATE", "NEES"]
    head += ["map", "walls, true walls"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    lines += [row(table.places[place], table, [place]) for place in closed]
    lines.append(row("**all of these**", table, closed))
    lines += [row(f"{table.places[place]} (open)", table, [place]) for place in known if place not in closed]
    failures, runs = int(failed(table)[closed].sum()), int(table.ran[closed].sum())
    low, high = wilson_interval(failures, runs)
    lines.append("")
    lines.append(
        f"Not `ok` without the open worlds: {failures} of {runs} runs, {100.0 * failures / runs:.1f} % "
        f"(95 % interval {100.0 * low:.1f} to {100.0 * high:.1f} %)."
    )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Compute the missing runs and write the table into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="directory of the sweep")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-run", action="store_true", help="only write the table")
    args = parser.parse_args()
    if not args.no_run:
        carry_out(args.runs, args.seeds, args.workers)
    write_table(DOCS / "accuracy.md", "worlds", text(read_sweep(args.runs)))


if __name__ == "__main__":
    main()
