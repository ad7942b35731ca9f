# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure the effect of each step of the filter (variants without it), and the saving by an adaptive particle count.

    python -m tools.measure.measure_variants RUNS [--places intel-1500,office] [--variants default,motion] [--seeds 3]
    python -m tools.measure.measure_variants RUNS --table counts [--places aces,loop] [--variants default,adaptive]

Writes: docs/algorithm.md (variants), docs/filter.md (counts)

Each run is kept as RUNS/<place>-<variant>-<seed>.npz (error, path, map, cost) and computed only once. Errors: mean of
the hand-checked relations for Intel and FR079; root mean square after SE(2) alignment (ATE) for worlds; for `aces` the
same against the published gMapping poses. For a log the seed is that of the filter; for a world it also determines the
noise of odometry and lidar. The table of counts uses all seeds that are in RUNS. The logs are read from
$TESTBED_DATASETS, by default ../shared/datasets.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import worlds
from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from eval.trajectory.relations import Relations, read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.run.estimate import Estimate
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from tools.pages import DOCS, write_table

DATASETS = Path(os.environ.get("TESTBED_DATASETS", DOCS.parents[1] / "shared" / "datasets"))
_INTEL = ("intel/intel-merged.clf.gz", "intel/intel-resolved.relations")
LOGS: dict[str, tuple[str, str, int | None]] = {
    "aces": ("aces/aces-merged.clf.gz", "aces/ref_gmapping_440.txt", None),
    "intel": (*_INTEL, None),
    "intel-1500": (*_INTEL, 1500),
    "fr079": ("fr079/fr079-merged.clf.gz", "fr079/fr079.relations", None),
}
"""Log; relations, or poses at the scans (`.txt`); number of scans that are used, None = all."""
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "scan-match": {"proposal.kind": "scan-match"},
    "motion": {"proposal.kind": "motion"},
    "always": {"resample.when": "always"},
    "never": {"resample.when": "never"},
    "one": {"particles": 1},
    "full-weight": {"match.weight_share": 1.0},
    "no-search": {"match.search_reach": 0.0},
    "fixed-10": {"particles": 10},
    "fixed-20": {"particles": 20},
    "adaptive": {"adapt.count": "kld"},
}
"""Changes to the default settings, by name of the variant."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames, and the reference for an estimate of them: relations or the true path."""

    frames: list[Frame]
    relations: Relations | None = None
    poses: NDArray[np.float64] | None = None
    """Reference poses at the scans, (scans, 3); None = the truth of the frames."""

    def error(self, estimate: Estimate) -> tuple[float, float]:
        """Error of position [m] and of heading [deg]; the module's docstring says which."""
        if self.relations is not None:
            relations = relation_error(estimate.dense, self.relations).all
            return relations.translation.mean, relations.rotation.mean
        poses = self.poses
        if poses is None:
            poses = np.array([frame.truth for frame in self.frames if frame.scan is not None])
        truth = Trajectory(estimate.at_scans.stamps, poses)
        absolute = absolute_error(associate(estimate.at_scans, truth), "se2")
        return absolute.translation.rmse, absolute.rotation.rmse


@lru_cache(maxsize=1)
def recording(place: str, seed: int) -> Recording:
    """A log, or a simulated drive through the world of that name with the noise of the seed."""
    if place in LOGS:
        log, reference, count = LOGS[place]
        frames = list(open_log(DATASETS / log).frames)
        scans = [number for number, frame in enumerate(frames) if frame.scan is not None]
        end = scans[count] if count is not None else None
        if reference.endswith(".txt"):
            return Recording(frames[:end], poses=np.loadtxt(DATASETS / reference)[:, 1:4])
        return Recording(frames[:end], read_relations(DATASETS / reference))
    with simulate(worlds.load(place), SimulationConfig(backend="fast", seeds=RunSeeds.from_seed(seed))) as simulation:
        return Recording(list(simulation))


def config_of(variant: str) -> FilterConfig:
    """Settings of a variant."""
    config = FilterConfig()
    for name, value in VARIANTS[variant].items():
        part, _, field = name.rpartition(".")
        changed = {field: value} if not part else {part: replace(getattr(config, part), **{field: value})}
        config = replace(config, **changed)
    return config


def run(place: str, variant: str, seed: int, target: Path) -> None:
    """Compute one run and write its results to `target`."""
    data = recording(place, seed if place not in LOGS else 0)
    estimation = Estimation(config_of(variant), RunSeeds.from_seed(seed).filter)
    for frame in data.frames:
        estimation.process(frame)
    own = estimation.filtered()
    start = time.perf_counter()
    refined = estimation.refined(own)
    refine_s = time.perf_counter() - start
    steps = estimation.steps.columns()
    odometry = estimation.trajectory_at_scans("odometry")
    assert odometry is not None
    np.savez_compressed(
        target,
        own=data.error(own),
        refined=data.error(refined),
        counts=steps["particles"][steps["updated"]],
        filter_s=steps["filter_s"].sum(),
        refine_s=refine_s,
        path=own.at_scans.poses,
        odometry=odometry.poses,
        probability=own.map.probability,
        resolution=own.map.resolution,
        origin=own.map.origin,
    )


def table_of_variants(runs: Path, places: list[str], variants: list[str], seeds: int) -> str:
    """Median and worst error over the seeds, of the filter's own path and after the final pass [cm]."""
    lines = ["| variant | setting | " + " | ".join(f"{place}, filter | {place}, final pass" for place in places) + " |"]
    lines.append("|---" * (2 + 2 * len(places)) + "|")
    for variant in variants:
        cells = []
        for place in places:
            cells += [f"{both} cm" for both in errors_of(results(runs, place, variant, seeds))]
        settings = ", ".join(f"`{name} = {value}`" for name, value in VARIANTS[variant].items())
        lines.append(f"| {variant} | {settings} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def table_of_counts(runs: Path, places: list[str], variants: list[str], seeds: int) -> str:
    """Errors over all seeds in `runs` (at least `seeds` of them), and the cost: particle-updates, mean and range of the
    count, wall time of the filter and its share in the time of filter and final pass together."""
    lines = ["| place | count | runs | filter | final pass | particle-updates | mean count | range | filter's time |"]
    lines.append("|---" * 9 + "|")
    for place in places:
        for variant in variants:
            there = len(list(runs.glob(f"{place}-{variant}-*.npz")))
            done = results(runs, place, variant, max(there, seeds))
            own, refined = errors_of(done)
            counts = np.concatenate([run["counts"] for run in done])
            seconds, rest = (np.mean([run[name] for run in done]) for name in ("filter_s", "refine_s"))
            lines.append(
                f"| {place} | {variant} | {there} | {own} cm | {refined} cm | {counts.sum() / there:.0f} | "
                f"{counts.mean():.1f} | {counts.min()} to {counts.max()} | "
                f"{seconds:.1f} s, {seconds / (seconds + rest):.0%} |"
            )
    return "\n".join(lines)


def results(runs: Path, place: str, variant: str, seeds: int) -> list[Any]:
    """Results of one variant in one place, by seed."""
    return [np.load(runs / f"{place}-{variant}-{seed}.npz") for seed in range(seeds)]


def errors_of(done: list[Any]) -> list[str]:
    """Median and worst error of position [cm], of the filter's own path and after the final pass."""
    errors = np.array([(run["own"], run["refined"]) for run in done])[:, :, 0] * 100.0
    return [f"{np.median(e):.1f} / {e.max():.1f}" for e in errors.T]


@dataclass(frozen=True)
class Table:
    """A table of the documentation, and its default content."""

    page: Path
    write: Callable[[Path, list[str], list[str], int], str]
    places: str
    variants: str
    seeds: int


TABLES = {
    "variants": Table(
        DOCS / "algorithm.md",
        table_of_variants,
        "intel-1500,office",
        "default,scan-match,motion,always,never,one,full-weight,no-search",
        3,
    ),
    "counts": Table(
        DOCS / "filter.md", table_of_counts, "aces,intel,loop,nested_loops", "fixed-10,default,adaptive", 5
    ),
}


def main() -> None:
    """Compute the missing runs, then write the table into its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="directory of the runs")
    parser.add_argument("--table", choices=TABLES, default="variants")
    parser.add_argument("--places")
    parser.add_argument("--variants")
    parser.add_argument("--seeds", type=int)
    args = parser.parse_args()
    args.runs.mkdir(parents=True, exist_ok=True)
    table = TABLES[args.table]
    places, variants = (args.places or table.places).split(","), (args.variants or table.variants).split(",")
    seeds = args.seeds or table.seeds
    for place in places:
        for seed in range(seeds):
            for variant in variants:
                target = args.runs / f"{place}-{variant}-{seed}.npz"
                if not target.exists():
                    run(place, variant, seed, target)
                    done = np.load(target)
                    print(f"{place} {variant} {seed}: {done['own'][0]:.4f} m, {done['refined'][0]:.4f} m", flush=True)
    write_table(table.page, args.table, table.write(args.runs, places, variants, seeds))


if __name__ == "__main__":
    main()
