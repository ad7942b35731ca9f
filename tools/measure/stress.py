# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Run the stress suite: how often the filter is lost under each perturbation, among the drives that can be survived.

    python -m tools.measure.stress RUNS [--runs 600] [--sample 60] [--only spin] [--particles 30] [--duration 120]

Prints: tables of lost runs by perturbation and severity, world, and robot, with intervals, and the runs that are lost

A run is lost if the outcome of its final estimate by the truth is `lost`. It counts where localisation in the *true*
map, from the true start, on the same perturbed data, stays found: then the data suffice. RUNS is a directory with one
file for each run; the command goes on where it was stopped. 600 runs take a few hours. A sample is drawn from the
design by a fixed seed, whatever there is in RUNS.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import worlds
from eval.files.atomic_write import atomic_write
from eval.map.grids import grid_from_true_map
from eval.outcome import evidence_from_truth, judge
from eval.sweep.statistics import wilson_interval
from eval.trajectory.association import associate
from slam.config import FilterConfig, LocalizationConfig
from testbed.estimation.estimation import Estimation
from testbed.estimation.known_map import KnownMap
from testbed.frame import Frame
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from testbed.stress.suite import SEVERITIES, Case, design, perturbed

DURATION = 120.0
"""Length of each drive unless another is wanted [s]: five faults of a moment."""
MAX_ERROR_M = 0.3
"""Localisation in the true map has stayed found if its median error is below this [m]."""


@lru_cache(maxsize=4)
def drive(world: str, robot: str, lidar: str, seed: int, duration: float) -> list[Frame]:
    """The frames of one drive along a random route, of at most so many seconds."""
    seeds = RunSeeds.from_seed(seed)
    place = worlds.random_route(worlds.load(world), np.random.default_rng(seeds.route))
    config = SimulationConfig(
        backend="fast", robot=load_robot(robot), lidar=load_lidar(lidar), seeds=seeds, duration=duration
    )
    with simulate(place, config) as simulation:
        return list(simulation)


def localised(case: Case, frames: list[Frame]) -> Estimation:
    """Localisation in the true map, from the true start, on these frames."""
    known = KnownMap(
        grid=grid_from_true_map(worlds.true_map(worlds.load(case.world))),
        start=frames[0].truth,
        settings=LocalizationConfig(),
        has_frame_of_truth=True,
    )
    estimation = Estimation(FilterConfig(), seed=RunSeeds.from_seed(case.seed).filter, threads=1, known_map=known)
    for frame in frames:
        estimation.process(frame)
    return estimation


def can_be_survived(case: Case, frames: list[Frame]) -> bool:
    """Whether localisation in the true map, from the true start, stays found on these frames."""
    return stays_found(localised(case, frames))


def stays_found(estimation: Estimation) -> bool:
    """Whether a localisation was never lost, and its median error is below `MAX_ERROR_M`."""
    status, truth = estimation.mapper.status, estimation.trajectory_at_scans("truth")
    if status.state != "found" or status.lost_at or truth is None:
        return False
    matched = associate(estimation.online(), truth)
    away = matched.estimate.poses[:, :2] - matched.reference.poses[:, :2]
    return bool(np.median(np.hypot(*away.T)) < MAX_ERROR_M)


def run(case: Case, particles: int, duration: float) -> dict[str, Any]:
    """Run the filter with its final pass, and the localisation, on a perturbed drive of at most so many seconds."""
    try:
        plain = drive(case.world, case.robot, case.lidar, case.seed, duration)
        frames = perturbed(plain, case.perturbation, case.severity)
    except worlds.WorldError as error:  # the robot does not fit into the world
        return {**asdict(case), "skipped": str(error)}
    config = FilterConfig(particles=particles)
    estimation = Estimation(config, seed=RunSeeds.from_seed(case.seed).filter, threads=1)
    for frame in frames:
        estimation.process(frame)
    truth = estimation.trajectory_at_scans("truth")
    if truth is None:
        raise ValueError(f"{case.name}: the simulated frames hold no truth")
    filtered = estimation.filtered()
    of_filter = judge(evidence_from_truth(associate(filtered.at_scans, truth)))
    outcome = judge(evidence_from_truth(associate(estimation.refined(filtered).at_scans, truth)))
    return {
        **asdict(case),
        "outcome": outcome.label,
        "reason": outcome.reason,
        "outcome_filter": of_filter.label,
        "survivable": can_be_survived(case, frames),
    }


def share(count: int, of: int) -> str:
    """A count with its 95 % Wilson interval, such as `2 of 20 (3% to 30%)`."""
    if of == 0:
        return "0 of 0"
    low, high = wilson_interval(count, of)
    return f"{count} of {of} ({low:.0%} to {high:.0%})"


def lost_share(rows: Sequence[dict[str, Any]]) -> str:
    """How many of the runs that can be survived are lost."""
    counted = [row for row in rows if row["survivable"]]
    return share(sum(row["outcome"] == "lost" for row in counted), len(counted))


def table(rows: Sequence[dict[str, Any]], factor: str) -> str:
    """Lost runs by a factor of the design and by severity, among those that can be survived, as Markdown."""
    lines = [f"| {factor} | {' | '.join(SEVERITIES)} | all | cannot be survived |", "|---|---|---|---|---|---|"]
    for value in [*sorted({row[factor] for row in rows}), "all"]:
        mine = [row for row in rows if value in ("all", row[factor])]
        at = [[row for row in mine if row["severity"] == severity] for severity in range(len(SEVERITIES))]
        hopeless = sum(not row["survivable"] for row in mine)
        lines.append(f"| {value} | {' | '.join(map(lost_share, [*at, mine]))} | {hopeless} |")
    return "\n".join(lines)


def sample(cases: Sequence[Case], count: int) -> list[Case]:
    """So many of the cases, drawn by a fixed seed; fewer of them are the first of more."""
    order = np.random.default_rng(60).permutation(len(cases))
    return [cases[k] for k in order[:count]]


def main() -> None:
    """Run what is missing, then print the tables and the lost runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="RUNS")
    parser.add_argument("--runs", type=int, default=600, help="size of the design")
    parser.add_argument("--sample", type=int, help="run only so many of them, drawn by a fixed seed")
    parser.add_argument("--only", help="one perturbation")
    parser.add_argument("--particles", type=int, default=FilterConfig().particles)
    parser.add_argument("--duration", type=float, default=DURATION, help="longest simulated time of a drive [s]")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    cases = design(options.runs)
    if options.sample is not None:
        cases = sample(cases, options.sample)
    rows = []
    try:
        for case in cases:
            if options.only in (None, case.perturbation):
                rows.append(_row(case, options))
    except KeyboardInterrupt:
        print(f"interrupted after {len(rows)} runs; the same command goes on with the others")
    ran = [row for row in rows if "skipped" not in row]
    print(f"\n{len(ran)} of {len(cases)} runs; the robot does not fit in {len(rows) - len(ran)} of them")
    for factor in ("perturbation", "world", "robot"):
        print("\n" + table(ran, factor))
    for row in ran:
        if row["outcome"] == "lost" and row["survivable"]:
            print(f"lost: {Case(**{name: row[name] for name in Case.__annotations__}).name}: {row['reason']}")


def _row(case: Case, options: argparse.Namespace) -> dict[str, Any]:
    """The result of a case, computed where its file is not there."""
    file: Path = options.out / f"{case.name}-{options.particles}-{options.duration:g}.json"
    if not file.exists():
        found = run(case, options.particles, options.duration)
        with atomic_write(file) as temporary:
            temporary.write_text(json.dumps(found, indent=1))
        said = found.get("skipped") or f"{found['outcome']}, {'' if found['survivable'] else 'not '}survivable"
        print(f"{case.name}: {said}", flush=True)
    content: dict[str, Any] = json.loads(file.read_text())
    return content


if __name__ == "__main__":
    main()
