# SPDX-License-Identifier: MIT
"""Compare what the final pass says the odometry errs by with errors that were simulated.

    python -m tools.measure.odometry_calibration [--worlds office,apartment,...] [--seeds 520:521]

Writes: docs/consistency.md (calibration)

A drive takes half a minute to two minutes of one core. Two particles: the final pass hardly depends on the filter.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import worlds
from slam.config import FilterConfig
from slam.refinement import refine
from testbed.estimation.estimation import Estimation
from testbed.seeds import RunSeeds
from testbed.simulation import OdometryConfig, SimulationConfig, simulate
from tools.pages import DOCS, write_table

PAGE = DOCS / "consistency.md"
WRONG = OdometryConfig(systematic=False, distance_scale=1.02, rotation_scale=0.97, drift=0.01)
"""Wheels 2 % smaller than stated, a track 3 % wider, and wheels that differ; random errors are the default's."""
MEANT = np.array(
    [
        1.0 / WRONG.distance_scale - 1.0,
        1.0 / WRONG.rotation_scale - 1.0,
        -WRONG.drift / (WRONG.distance_scale * WRONG.rotation_scale),
    ]
)
"""Corrections (3,) that undo these errors, as `Refined.odometry_correction`."""


@dataclass(frozen=True, eq=False)
class Found:
    """Corrections of one drive."""

    errors: NDArray[np.float64]
    """By how much they differ from those that are meant, (3,)."""
    sigmas: NDArray[np.float64]
    """Their stated standard deviations, (3,)."""


def calibrate(world: str, seed: int) -> Found:
    """Drive through a world and read off what the final pass says of the odometry."""
    seeds = RunSeeds.from_seed(seed)
    estimation = Estimation(FilterConfig(particles=2), seeds.filter, threads=1)
    config = SimulationConfig(backend="fast", seeds=seeds, odometry=WRONG)
    frames = []
    with simulate(worlds.load(world), config) as simulation:
        for frame in simulation:
            estimation.process(frame)
            frames.append(frame)
    result = refine(
        estimation.odometry,
        [frame.scan for frame in frames],
        estimation.filtered().dense.poses,
        estimation.config,
        twists=[frame.twist for frame in frames],
        stamps=estimation.stamps,
        threads=1,
    )
    return Found(result.odometry_correction - MEANT, result.odometry_correction_sigma)


def row(world: str, drives: list[Found]) -> str:
    """One line of the table: root mean square error and stated deviation of each correction."""
    errors = np.sqrt(np.mean([drive.errors**2 for drive in drives], axis=0))
    sigmas = np.sqrt(np.mean([drive.sigmas**2 for drive in drives], axis=0))
    shares = [f"{100.0 * e:.2f} % ({100.0 * s:.2f})" for e, s in zip(errors[:2], sigmas[:2], strict=True)]
    return f"| {world} | {len(drives)} | {' | '.join(shares)} | {1e3 * errors[2]:.1f} mrad/m ({1e3 * sigmas[2]:.1f}) |"


def main() -> None:
    """Make the drives and write the table into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", default="office,apartment,maze,hall,long_corridor")
    parser.add_argument("--seeds", default="520:521", help="first seed and the one after the last")
    args = parser.parse_args()
    seeds = range(*map(int, args.seeds.split(":")))
    rows = [row(world, [calibrate(world, seed) for seed in seeds]) for world in args.worlds.split(",")]
    head = "| world | drives | distance | rotation | drift |\n|---|---|---|---|---|"
    write_table(PAGE, "calibration", "\n".join([head, *rows]))


if __name__ == "__main__":
    main()
