# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Count how often a robot that explores touches something, in ten worlds and on both backends.

    python -m tools.measure.measure_collisions [--seeds 10] [--backends fast,pybullet] [--duration 200]

Prints: the number of contacts per world and backend

The worlds are five of the catalogue and one of each kind of generated world with interiors; the strategy is
`information`, the filter has 5 particles. Takes about 15 s of one core for each run.
"""

from __future__ import annotations

import argparse
from typing import Literal

import numpy as np

from slam.config.filter import FilterConfig
from slam.gmapping import GMapping
from testbed.exploration import ExploreDriver, make_explorer
from testbed.seeds import RunSeeds
from testbed.simulation import DriverConfig, Simulation, SimulationConfig, simulate
from worlds import load

WORLDS = (
    "apartment", "office", "lab", "museum", "warehouse",
    "generated:rooms:size=16x12:1", "generated:loops:size=16x12:2", "generated:cave:size=16x12:3",
    "generated:maze:size=16x12:4", "generated:warehouse:size=16x12:5",
)  # fmt: skip
Backend = Literal["fast", "pybullet"]


def explore(world: str, seed: int, backend: Backend, duration: float) -> Simulation:
    """Explore a world by the estimate; returns the simulation at its end."""
    seeds = RunSeeds.from_seed(seed)
    config = SimulationConfig(
        backend=backend, seeds=seeds, duration=duration, driver=DriverConfig(kind="explore", strategy="information")
    )
    rng = np.random.default_rng(seeds.driver)
    driver = ExploreDriver(make_explorer(config.robot, config.lidar, config.driver, rng))
    mapper = GMapping(FilterConfig(particles=5), seed=seeds.filter)
    with simulate(load(world), config, driver) as simulation:
        for frame in simulation:
            if frame.scan is not None:
                driver.observe(frame, mapper.process(frame.odometry, frame.scan, twist=frame.twist), mapper.map)
    return simulation


def main() -> None:
    """Run all explorations and print one line for each world and backend."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--backends", default="fast,pybullet")
    parser.add_argument("--duration", type=float, default=200.0, help="longest drive [s]")
    options = parser.parse_args()
    print("| world | backend | runs | finished | collided | stuck | backed off |", flush=True)
    print("|---|---|---|---|---|---|---|")
    for world in WORLDS:
        for backend in options.backends.split(","):
            runs = [explore(world, seed, backend, options.duration) for seed in range(options.seeds)]
            counts = (
                sum(run.finished for run in runs),
                sum(run.collided for run in runs),
                sum(run.stuck for run in runs),
                sum(run.driver.recoveries for run in runs),
            )
            print(f"| {world} | {backend} | {len(runs)} | {' | '.join(map(str, counts))} |", flush=True)


if __name__ == "__main__":
    main()
