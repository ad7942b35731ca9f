# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure the accuracy on the recorded logs over seeds, particle counts and settings.

    python -m tools.measure.real_logs --particles 5,30 --seeds 5
    python -m tools.measure.real_logs --logs aces --particles 30 --seeds 20 --set match.beam_weight=0.2
    python -m tools.measure.real_logs --logs aces --particles 30 --seeds 20 --first-seed 100 --filter-only

Prints: the figures of recorded logs in docs/accuracy.md, one line for each run

Every log is mapped with the same settings. A line gives the error of the filter's own path, that of the poses that it
reported online, when nothing later was known, and that after the final pass. For logs with relations it is the mean
error of the pairs (translation, rotation); for the others it is the root mean square distance to the published gMapping
poses after SE(2) alignment, which are themselves some centimetres off: it tells which runs are lost, and ranks nothing.
The relations of `csail` are from a graph optimiser. The logs are read from $TESTBED_DATASETS, by default
../shared/datasets.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from eval.trajectory.relations import EXACT, Relations, read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.run.estimate import Estimate
from testbed.seeds import RunSeeds

ROOT = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).resolve().parents[2].parent / "shared" / "datasets"))


NEAREST = 0.1
"""Published poses and scans belong together where their stamps differ by less than this [s]."""


@dataclass(frozen=True)
class Case:
    """A log and the reference for its estimate."""

    log: Path
    relations: Path | None = None
    poses: Path | None = None
    failed: float = 0.1
    """Translation error above which a run counts as failed [m]."""
    tolerance: float | None = None
    """Stamps of relations and poses match within this time [s]; None: exactly."""


CASES = {
    "intel": Case(ROOT / "intel/intel-merged.clf.gz", relations=ROOT / "intel/intel-resolved.relations"),
    "fr079": Case(ROOT / "fr079/fr079-merged.clf.gz", relations=ROOT / "fr079/fr079.relations"),
    "aces": Case(ROOT / "aces/aces-merged.clf.gz", poses=ROOT / "aces/ref_gmapping_440.txt", failed=0.5),
    "csail": Case(
        ROOT / "csail/csail-merged.clf.gz", relations=ROOT / "csail/csail-flirtgraph.relations", tolerance=0.05
    ),
    "seattle": Case(ROOT / "seattle/seattle-merged.clf.gz", poses=ROOT / "seattle/ref_gmapping_241.txt", failed=0.5),
    "edmonton": Case(
        ROOT / "edmonton/edmonton-merged.clf.gz", poses=ROOT / "edmonton/ref_gmapping_340.txt", failed=0.5
    ),
    "acapulco": Case(
        ROOT / "acapulco/acapulco-merged.clf.gz", poses=ROOT / "acapulco/ref_gmapping_861.txt", failed=0.5
    ),
}


def error_of(case: Case, estimate: Estimate, relations: Relations | None) -> tuple[float, float]:
    """Translation [m] and rotation [deg]; rotation is NaN for a log without relations."""
    if relations is not None:
        error = relation_error(estimate.dense, relations, tolerance=EXACT if case.tolerance is None else case.tolerance)
        return error.all.translation.mean, error.all.rotation.mean
    assert case.poses is not None
    rows = np.loadtxt(case.poses)
    reference = Trajectory(rows[:, 0], rows[:, 1:4])
    matched = associate(estimate.at_scans, reference, tolerance=NEAREST, interpolate=False)
    return absolute_error(matched, "se2").translation.rmse, float("nan")


def estimates(frames: list[Frame], config: FilterConfig, seed: int, *, final: bool) -> tuple[list[Estimate], float]:
    """The filter's own estimate, that online and, where wanted, that after the final pass; the time of all [s]."""
    start = time.perf_counter()
    estimation = Estimation(config, RunSeeds.from_seed(seed).filter)  # as `testbed slam --seed` does
    for frame in frames:
        estimation.process(frame)
    own = estimation.filtered()
    found = [own, replace(own, dense=estimation.online(), scan_frames=np.arange(len(own.scan_frames)))]
    if final:
        found.append(estimation.refined(own))
    return found, time.perf_counter() - start


def settings(changes: list[str], particles: int) -> FilterConfig:
    """The default configuration with changes such as `match.beam_weight=0.2`."""
    config = FilterConfig(particles=particles)
    for change in changes:
        key, value = change.split("=", 1)
        parsed: Any = tomllib.loads(f"v = {value}")["v"]
        part, _, name = key.rpartition(".")
        inner = replace(getattr(config, part), **{name: parsed}) if part else None
        config = replace(config, **({part: inner} if part else {name: parsed}))
    return config


def main() -> None:
    """Map the logs and print one line for each run, one for each particle count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", default="intel,fr079,aces")
    parser.add_argument("--particles", default="30")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--filter-only", action="store_true", help="no final pass")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="changes")
    args = parser.parse_args()
    print("log particles seed own_m own_deg online_m online_deg refined_m refined_deg seconds", flush=True)
    for name in args.logs.split(","):
        case = CASES[name]
        if not case.log.is_file():
            print(f"skipping {name}: {case.log} does not exist", file=sys.stderr)
            continue
        frames = list(open_log(case.log).frames)
        relations = read_relations(case.relations) if case.relations else None
        for particles in map(int, args.particles.split(",")):
            rows = []
            for seed in range(args.first_seed, args.first_seed + args.seeds):
                config = settings(args.changes, particles)
                found, seconds = estimates(frames, config, seed, final=not args.filter_only)
                errors = [error_of(case, estimate, relations) for estimate in found]
                numbers = " ".join(f"{metres:.4f} {degrees:.3f}" for metres, degrees in errors)
                print(f"{name} {particles} {seed} {numbers} {seconds:.1f}", flush=True)
                rows.append([metres for metres, _ in errors])
            for label, column in zip(("own path", "online", "final"), np.array(rows).T, strict=False):
                failed = f"{np.sum(column > case.failed)} of {len(column)} failed (> {case.failed} m)"
                figures = f"worst {column.max():.4f} m, median {np.median(column):.4f} m"
                print(f"# {name} {particles} particles, {label}: {figures}, {failed}", flush=True)


if __name__ == "__main__":
    main()
