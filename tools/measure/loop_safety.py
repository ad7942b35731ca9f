# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Look for harm done by closing loops: wrong loops that were accepted, and drives that end worse than without.

    python -m tools.measure.loop_safety RUNS [--worlds symmetric,warehouse,maze,office,nested_loops] [--seeds 800:840]

Prints: a table by world, with 95 % intervals, and every run that was harmed

Each drive is mapped with few particles and poor odometry, so that the filter leaves loops open, and its final pass is
made with and without closing them. Where the loops changed nothing, both are the same to the bit, and only one is made.
A loop is wrong where it puts two local maps elsewhere than they were by more than `WRONG_POSITION` or `WRONG_HEADING`;
a run is harmed where its error (root mean square of position, after alignment) is larger by more than `HARM`. RUNS is a
directory with one file for each run; the command goes on where it was stopped. A run takes half a minute to three
minutes of one core.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import worlds
from eval.files.atomic_write import atomic_write
from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from slam import se2
from slam.config import FilterConfig
from slam.loops import LoopClosing
from testbed.estimation.estimation import Estimation
from testbed.seeds import RunSeeds
from testbed.simulation import OdometryConfig, SimulationConfig, simulate
from tools.measure.stress import share

WRONG_POSITION, WRONG_HEADING = 0.3, 0.1
"""A loop errs by more than this [m, rad] only where it joins different places: three to ten times the standard
deviations that matches state."""
HARM = 0.01
"""By how much a run may end worse than without loops [m]."""


def loop_errors(closing: LoopClosing, truth: se2.Pose) -> NDArray[np.float64]:
    """By how much each loop errs in position [m] and heading [rad], (loops, 2); truth (frames, 3)."""
    nodes = truth[closing.frames]
    errors = np.zeros((len(closing.loops), 2))
    for k, loop in enumerate(closing.loops):
        x, y, turn = se2.between(se2.between(nodes[loop.first], nodes[loop.second]), loop.pose).tolist()
        errors[k] = np.hypot(x, y), abs(turn)
    return errors


def are_wrong(errors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether loops with errors (loops, 2) join different places, (loops,)."""
    return np.logical_or(errors[:, 0] > WRONG_POSITION, errors[:, 1] > WRONG_HEADING)


def run(world: str, seed: int, particles: int) -> dict[str, Any]:
    """Map one drive with and without closing loops."""
    seeds = RunSeeds.from_seed(seed)
    config = FilterConfig(particles=particles)
    estimation = Estimation(config, seeds.filter, threads=1)
    odometry = OdometryConfig(grade="poor")
    with simulate(worlds.load(world), SimulationConfig(backend="fast", seeds=seeds, odometry=odometry)) as simulation:
        for frame in simulation:
            estimation.process(frame)
    truth = estimation.trajectory_at_scans("truth")
    assert truth is not None
    filtered = estimation.filtered()
    closed = estimation.refined(filtered)
    closing = closed.closing
    assert closing is not None
    unclosed = closed
    if closing.changed:
        estimation.config = replace(config, refine=replace(config.refine, close_loops=False))
        unclosed = estimation.refined(filtered)
    errors = loop_errors(closing, np.array([frame.truth for frame in estimation.frames]))
    of_filter, with_loops, without = (
        absolute_error(associate(estimate.at_scans, truth), "se2").translation.rmse
        for estimate in (filtered, closed, unclosed)
    )
    return {
        "world": world,
        "seed": seed,
        "particles": particles,
        "changed": closing.changed,
        "accepted": int(closing.accepted.sum()),
        "accepted_wrong": int((are_wrong(errors) & closing.accepted).sum()),
        "rejected": int((~closing.accepted).sum()),
        "rejected_right": int((~are_wrong(errors) & ~closing.accepted).sum()),
        "largest_error_m": float(errors[closing.accepted, 0].max(initial=0.0)),
        "ate_filter_m": of_filter,
        "ate_m": with_loops,
        "ate_without_m": without,
    }


def is_harmed(row: dict[str, Any]) -> bool:
    """Whether a run has a wrong loop, or ended worse than without."""
    return bool(row["accepted_wrong"] > 0 or row["ate_m"] > row["ate_without_m"] + HARM)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """One line for each world, and one for all."""
    names = list(dict.fromkeys(row["world"] for row in rows))
    parts = [(name, [row for row in rows if row["world"] == name]) for name in names]
    head = "| world | runs | changed | wrong of accepted loops | rejected (right ones) | worst change | harmed runs |"
    return "\n".join([head, "|---|---|---|---|---|---|---|", *(_line(*part) for part in [*parts, ("all", rows)])])


def _line(name: str, rows: Sequence[dict[str, Any]]) -> str:
    accepted, wrong, rejected, right = (
        sum(row[key] for row in rows) for key in ("accepted", "accepted_wrong", "rejected", "rejected_right")
    )
    worst = max((1e3 * (row["ate_m"] - row["ate_without_m"]) for row in rows), default=0.0)
    return (
        f"| {name} | {len(rows)} | {sum(row['changed'] for row in rows)} | {share(wrong, accepted)} | "
        f"{rejected} ({right}) | {worst:+.1f} mm | {share(sum(map(is_harmed, rows)), len(rows))} |"
    )


def main() -> None:
    """Make the runs that are missing, and print the table of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, metavar="RUNS")
    parser.add_argument("--worlds", default="symmetric,warehouse,maze,office,nested_loops")
    parser.add_argument("--seeds", default="800:840", help="first seed and the one after the last")
    parser.add_argument("--particles", type=int, default=2)
    parser.add_argument("--table-only", action="store_true", help="print the table of the runs that there are")
    args = parser.parse_args()
    args.runs.mkdir(parents=True, exist_ok=True)
    for seed in () if args.table_only else range(*map(int, args.seeds.split(":"))):
        for world in args.worlds.split(","):
            path = args.runs / f"{world}_{seed}_{args.particles}.json"
            if not path.is_file():
                found = run(world, seed, args.particles)
                with atomic_write(path) as temporary:
                    temporary.write_text(json.dumps(found, indent=1), encoding="utf-8")
    rows = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(args.runs.glob("*.json"))]
    print(table(rows))
    for row in filter(is_harmed, rows):
        print(json.dumps(row))


if __name__ == "__main__":
    main()
