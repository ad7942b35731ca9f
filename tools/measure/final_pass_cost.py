# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure time and memory of the final pass on a long drive with many beams, in a process of its own.

    python -m tools.measure.final_pass_cost [--world campus] [--minutes 20] [--lidar ust10lx] [--threads 2]

Prints: the figures of the final pass's cost in docs/filter.md, as one JSON object

Memory is by how much the resident size of the process grows at most (Linux), while it drives, and from there in the
final pass; pages of files with readings count. The filter has two particles, since the final pass needs but one path; a
lidar of 1081 beams at 40 Hz is the default. Wall times are of this machine.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

import worlds
from slam import se2
from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.presets import load_lidar
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from testbed.systems.memory import peak_memory


def measured(world: str, minutes: float, lidar: str, threads: int, seed: int) -> dict[str, float | None]:
    """Drive through a world, make the final pass and return its figures."""
    seeds = RunSeeds.from_seed(seed)
    estimation = Estimation(FilterConfig(particles=2), seeds.filter, threads=threads)
    config = SimulationConfig(backend="fast", seeds=seeds, lidar=load_lidar(lidar), duration=60.0 * minutes)
    loaded, begin = worlds.load(world), time.perf_counter()
    with peak_memory() as of_drive:
        with simulate(loaded, config) as simulation:
            for frame in simulation:
                estimation.process(frame)
        filtered = estimation.filtered()
    driven = time.perf_counter()
    with peak_memory() as of_pass:
        refined = estimation.refined(filtered)
    ended = time.perf_counter()
    steps = se2.between(refined.dense.poses[:-1], refined.dense.poses[1:])
    return {
        "drive_s": round(float(refined.dense.stamps[-1]), 1),
        "path_m": round(float(np.hypot(steps[:, 0], steps[:, 1]).sum()), 1),
        "scans": len(refined.scan_frames),
        "driving_and_filter_s": round(driven - begin, 1),
        "final_pass_s": round(ended - driven, 1),
        "frames_and_filter_mb": of_drive.megabytes,
        "final_pass_mb": of_pass.megabytes,
        "map_mb": round(refined.map.probability.nbytes / 1e6, 1),
    }


def main() -> None:
    """Print the figures of one drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", default="campus")
    parser.add_argument("--minutes", type=float, default=20.0, help="simulated time")
    parser.add_argument("--lidar", default="ust10lx", help="preset of the lidar")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seed", type=int, default=500)
    args = parser.parse_args()
    print(json.dumps(measured(args.world, args.minutes, args.lidar, args.threads, args.seed)))


if __name__ == "__main__":
    main()
