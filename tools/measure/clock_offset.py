# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure how well a late clock of the scans is found, in simulated drives of 40 s whose scans are stamped too late.

    python -m tools.measure.clock_offset [--worlds office,maze] [--seeds 70:71] [--late 0.15]

Prints: for each world and seed the offset that is found and by how much it is wrong, as docs/recordings.md states it;
then the root mean square and the largest of the errors. "none": the robot turns too little to tell.
"""

import argparse
import math
from pathlib import Path

import numpy as np

from testbed.formats import Log
from testbed.frame_table import FrameTable
from testbed.inspect.time_offset import estimate_offset, shifted
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from worlds import load

WORLDS = "apartment,cave,lab,loop,maze,museum,nested_loops,office,symmetric,warehouse"
SECONDS = 40.0


def late_drive(world: str, seed: int, late: float) -> FrameTable:
    """A drive whose scans are stamped so much too late [s]."""
    config = SimulationConfig(backend="fast", duration=SECONDS, seeds=RunSeeds.from_seed(seed))
    frames = list(simulate(load(world), config))
    table = Log.from_frames(frames, path=Path(world), format="simulation").table
    return shifted(table, -late)[0]


def main() -> None:
    """Estimate the offset of each drive and print the errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", default=WORLDS, help="names of worlds, separated by commas")
    parser.add_argument("--seeds", default="70:71", help="first seed and the one after the last")
    parser.add_argument("--late", type=float, default=0.15, help="seconds")
    args = parser.parse_args()
    first, end = map(int, args.seeds.split(":"))
    errors = []
    for world in args.worlds.split(","):
        for seed in range(first, end):
            clock = estimate_offset(late_drive(world, seed, args.late))
            if clock is None or not math.isfinite(clock.uncertainty):
                print(f"{world:14} {seed:4}  none", flush=True)
                continue
            errors.append(1e3 * (clock.offset - args.late))
            print(f"{world:14} {seed:4}  {clock.offset:+.3f} s, wrong by {errors[-1]:+5.1f} ms", flush=True)
    if errors:
        largest = float(np.abs(errors).max())
        print(f"{len(errors)} drives: rms {np.sqrt(np.mean(np.square(errors))):.1f} ms, largest {largest:.1f} ms")


if __name__ == "__main__":
    main()
