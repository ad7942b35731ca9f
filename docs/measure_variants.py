# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""What each step of the filter is worth: variants that leave one out, on the same log; the table of docs/algorithm.md.

    python docs/measure_variants.py RUNS [--places intel-1500,office] [--variants default,motion] [--seeds 3]

Each run is kept as RUNS/<place>-<variant>-<seed>.npz (error, path, map); what is there is not computed again. Errors:
mean of the hand-checked relations for the logs, whose seeds are those of the filter alone; root mean square
after SE(2) alignment (ATE) for `office`, where the seed decides the noise of odometry and lidar as well. The logs are
looked for in $TESTBED_DATASETS, else in ../shared/datasets.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import worlds
from eval.association import associate
from eval.relations import Relations, read_relations, relation_error
from eval.trajectory import Trajectory
from eval.trajectory_error import absolute_error
from slam.config import FilterConfig
from testbed.estimation import Estimate, Estimation
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.simulation import SimulationConfig, simulate
from testbed.streams import streams

PAGE = Path(__file__).resolve().parent / "algorithm.md"
BEGIN, END = "<!-- variants: written by docs/measure_variants.py -->\n", "<!-- /variants -->\n"
DATASETS = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).resolve().parents[2] / "shared" / "datasets"))
_INTEL = ("intel/intel-merged.clf.gz", "intel/intel-resolved.relations")
LOGS: dict[str, tuple[str, str, int | None]] = {
    "intel": (*_INTEL, None),
    "intel-1500": (*_INTEL, 1500),
    "fr079": ("fr079/fr079-merged.clf.gz", "fr079/fr079.relations", None),
}
"""Log, relations, and how many scans of it are taken; None = all."""
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "scan-match": {"proposal.kind": "scan-match"},
    "motion": {"proposal.kind": "motion"},
    "always": {"resample.when": "always"},
    "never": {"resample.when": "never"},
    "one": {"particles": 1},
    "full-weight": {"match.weight_share": 1.0},
    "no-search": {"match.search_reach": 0.0},
}
"""Settings that differ from the defaults, by the name of the variant."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames, and what an estimate of them is scored by: relations or the true path."""

    frames: list[Frame]
    relations: Relations | None = None

    def error(self, estimate: Estimate) -> tuple[float, float]:
        """Error of position [m] and of heading [deg], see above."""
        if self.relations is not None:
            relations = relation_error(estimate.dense, self.relations).all
            return relations.translation.mean, relations.rotation.mean
        seen = [frame for frame in self.frames if frame.scan is not None]
        truth = Trajectory(estimate.at_scans.stamps, np.array([frame.truth for frame in seen]))
        absolute = absolute_error(associate(estimate.at_scans, truth), "se2")
        return absolute.translation.rmse, absolute.rotation.rmse


@lru_cache(maxsize=1)
def recording(place: str, seed: int) -> Recording:
    """A log, or a drive through the world of that name with the noise of the seed."""
    if place in LOGS:
        log, relations, count = LOGS[place]
        frames = list(open_log(DATASETS / log).frames)
        scans = [number for number, frame in enumerate(frames) if frame.scan is not None]
        end = scans[count] if count is not None else None
        return Recording(frames[:end], read_relations(DATASETS / relations))
    with simulate(worlds.load(place), SimulationConfig(backend="fast", seed=seed)) as simulation:
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
    """Carry out one run and keep what came of it."""
    data = recording(place, seed if place not in LOGS else 0)
    estimation = Estimation(config_of(variant), streams(seed).filter)
    for frame in data.frames:
        estimation.process(frame)
    own = estimation.filtered()
    refined = estimation.refined(own)
    odometry = estimation.trajectory_at_scans("odometry")
    assert odometry is not None
    np.savez_compressed(
        target,
        own=data.error(own),
        refined=data.error(refined),
        path=own.at_scans.poses,
        odometry=odometry.poses,
        probability=own.map.probability,
        resolution=own.map.resolution,
        origin=own.map.origin,
    )


def table(runs: Path, places: list[str], variants: list[str], seeds: int) -> str:
    """Median and worst error over the seeds, of the filter's own path and after the final pass [cm]."""
    lines = ["| variant | setting | " + " | ".join(f"{place}, filter | {place}, final pass" for place in places) + " |"]
    lines.append("|---" * (2 + 2 * len(places)) + "|")
    for variant in variants:
        cells = []
        for place in places:
            files = [runs / f"{place}-{variant}-{seed}.npz" for seed in range(seeds)]
            errors = np.array([(run["own"], run["refined"]) for run in map(np.load, files)])[:, :, 0] * 100.0
            cells += [f"{np.median(e):.1f} / {e.max():.1f} cm" for e in errors.T]
        settings = ", ".join(f"`{name} = {value}`" for name, value in VARIANTS[variant].items())
        lines.append(f"| {variant} | {settings} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Carry out what is missing, then write the table into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="directory of the runs")
    parser.add_argument("--places", default="intel-1500,office")
    parser.add_argument("--variants", default=",".join(VARIANTS))
    parser.add_argument("--seeds", type=int, default=3)
    args = parser.parse_args()
    args.runs.mkdir(parents=True, exist_ok=True)
    places, variants = args.places.split(","), args.variants.split(",")
    for place in places:
        for seed in range(args.seeds):
            for variant in variants:
                target = args.runs / f"{place}-{variant}-{seed}.npz"
                if not target.exists():
                    run(place, variant, seed, target)
                    done = np.load(target)
                    print(f"{place} {variant} {seed}: {done['own'][0]:.4f} m, {done['refined'][0]:.4f} m", flush=True)
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    text = before + BEGIN + table(args.runs, places, variants, args.seeds) + "\n" + END + rest.partition(END)[2]
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
