# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Run the stress suite: how often the filter is lost under each perturbation, among the drives that can be survived.

    python -m tools.measure.stress RUNS [--runs 600] [--only "slip on the spot"]

Prints: the table of lost runs by perturbation and severity, with intervals, and the runs that are lost

A run is lost if its outcome by the truth is `lost`. It counts where localisation in the *true* map, from the true
start, on the same perturbed data, stays found: then the data suffice. RUNS is a directory with one file for each run;
the command goes on where it was stopped. 600 runs take a few hours.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

import worlds
from eval.files.atomic_write import atomic_write
from eval.map.grids import grid_from_true_map
from eval.outcome import evidence_from_truth, judge
from eval.trajectory.association import associate
from slam.config import FilterConfig, LocalizationConfig
from testbed.frame import Frame
from testbed.presets import load_lidar, load_robot
from testbed.run.estimation import Estimation
from testbed.run.known_map import KnownMap
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from testbed.stress.suite import SEVERITIES, Case, design, perturbed

DURATION = 150.0
"""Length of each drive [s]: seven faults of a moment."""
MAX_ERROR_M = 0.3
"""Localisation in the true map has stayed found if its median error is below this [m]."""


@lru_cache(maxsize=4)
def drive(world: str, robot: str, lidar: str, seed: int) -> list[Frame]:
    """The frames of one drive along a random route."""
    seeds = RunSeeds.from_seed(seed)
    place = worlds.random_route(worlds.load(world), np.random.default_rng(seeds.route))
    config = SimulationConfig(
        backend="fast", robot=load_robot(robot), lidar=load_lidar(lidar), seeds=seeds, duration=DURATION
    )
    with simulate(place, config) as simulation:
        return list(simulation)


def can_be_survived(case: Case, frames: list[Frame]) -> bool:
    """Whether localisation in the true map, from the true start, stays found on these frames."""
    known = KnownMap(
        grid=grid_from_true_map(worlds.true_map(worlds.load(case.world))),
        start=frames[0].truth,
        settings=LocalizationConfig(),
        has_frame_of_truth=True,
    )
    estimation = Estimation(FilterConfig(), seed=RunSeeds.from_seed(case.seed).filter, threads=1, known_map=known)
    for frame in frames:
        estimation.process(frame)
    status, truth = estimation.mapper.status, estimation.trajectory_at_scans("truth")
    if status.state != "found" or status.lost_at or truth is None:
        return False
    matched = associate(estimation.online(), truth)
    away = matched.estimate.poses[:, :2] - matched.reference.poses[:, :2]
    return bool(np.median(np.hypot(*away.T)) < MAX_ERROR_M)


def run(case: Case) -> dict[str, Any]:
    """Run the filter and the localisation on a perturbed drive."""
    frames = perturbed(drive(case.world, case.robot, case.lidar, case.seed), case.perturbation, case.severity)
    estimation = Estimation(FilterConfig(), seed=RunSeeds.from_seed(case.seed).filter, threads=1)
    for frame in frames:
        estimation.process(frame)
    truth = estimation.trajectory_at_scans("truth")
    if truth is None:
        raise ValueError(f"{case.name}: the simulated frames hold no truth")
    outcome = judge(evidence_from_truth(associate(estimation.filtered().at_scans, truth)))
    return {
        **asdict(case),
        "outcome": outcome.label,
        "reason": outcome.reason,
        "survivable": can_be_survived(case, frames),
    }


def share(lost: int, runs: int) -> str:
    """A count with its Wilson interval."""
    if runs == 0:
        return "0 of 0"
    low, high = binomtest(lost, runs).proportion_ci(method="wilson")
    return f"{lost} of {runs} ({low:.0%} to {high:.0%})"


def table(rows: list[dict[str, Any]]) -> str:
    """Lost runs by perturbation and severity, among those that can be survived, as Markdown."""
    lines = [f"| perturbation | {' | '.join(SEVERITIES)} | all | cannot be survived |", "|---|---|---|---|---|---|"]
    names = sorted({row["perturbation"] for row in rows})
    for name in [*names, "all"]:
        mine = [row for row in rows if name in ("all", row["perturbation"])]
        counted = [row for row in mine if row["survivable"]]
        cells = []
        for severity in (0, 1, 2, None):
            at = [row for row in counted if severity is None or row["severity"] == severity]
            cells.append(share(sum(row["outcome"] == "lost" for row in at), len(at)))
        lines.append(f"| {name} | {' | '.join(cells)} | {len(mine) - len(counted)} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is missing, then print the table and the lost runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="RUNS")
    parser.add_argument("--runs", type=int, default=600)
    parser.add_argument("--only", help="one perturbation")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for case in design(options.runs):
        if options.only not in (None, case.perturbation):
            continue
        file = options.out / f"{case.name}.json"
        if not file.exists():
            found = run(case)
            with atomic_write(file) as temporary:
                temporary.write_text(json.dumps(found, indent=1))
            print(f"{case.name}: {found['outcome']}, {'' if found['survivable'] else 'not '}survivable", flush=True)
        rows.append(json.loads(file.read_text()))
    print("\n" + table(rows))
    for row in rows:
        if row["outcome"] == "lost" and row["survivable"]:
            print(f"lost: {Case(**{name: row[name] for name in Case.__annotations__}).name}: {row['reason']}")


if __name__ == "__main__":
    main()
