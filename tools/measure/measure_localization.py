# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure localisation from an unknown start in the true map of every world.

    python -m tools.measure.measure_localization [--seeds 5]

Prints: the table of docs/localization.md

Each robot starts at a random point of the tour, knows the true map but not its pose, and drives for 40 s.
"""

from __future__ import annotations

import argparse

import numpy as np

from eval.map.grids import grid_from_true_map
from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from eval.trajectory.trajectory import Trajectory
from slam.localization import Localization
from slam.occupancy import OccupancyGrid
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from worlds import catalogue, load, true_map

LATEST_BEGIN = 40.0
"""The start is drawn from the first part of the tour, up to this time [s]."""
DURATION = 40.0
"""Length of each drive [s]."""


def outcome(world: str, grid: OccupancyGrid, seed: int) -> tuple[str, float, float]:
    """State at the end, distance driven until the robot was found [m] (NaN = never), median error of the path [m]."""
    begin = float(np.random.default_rng(seed).uniform(0.0, LATEST_BEGIN))
    config = SimulationConfig(backend="fast", seeds=RunSeeds.from_seed(seed), duration=begin + DURATION)
    localization = Localization(grid, seed=seed)
    stamps, truth = [], []
    with simulate(load(world), config) as simulation:
        for frame in simulation:
            if frame.stamp >= begin and frame.scan is not None:
                localization.process(frame.odometry, frame.scan, twist=frame.twist)
                stamps.append(frame.stamp)
                truth.append(frame.truth)
    true_path = Trajectory(np.array(stamps), np.array(truth))
    found = localization.status
    scans = localization.update_scans
    path = Trajectory(true_path.stamps[scans], localization.path())
    error = absolute_error(associate(path, true_path), "none").translation.median
    after = float(true_path.distance[found.found_at[0]]) if found.found_at else np.nan
    state = found.state if not found.lost_at else "lost"
    if state == "found" and error > 0.5:
        state = "wrong"
    return state, after, error


def main() -> None:
    """Print one line for each world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    seeds = parser.parse_args().seeds
    print(
        "| world | found | ambiguous | searching | lost or wrong | found after: median, worst | error: median, worst |"
    )
    print("|---|---|---|---|---|---|---|")
    for world in catalogue():
        grid = grid_from_true_map(true_map(load(world)))
        runs = [outcome(world, grid, seed) for seed in range(seeds)]
        states = [state for state, _, _ in runs]
        found = [(after, error) for state, after, error in runs if state == "found"]
        figures = "| | |"
        if found:
            after, error = np.array(found).T
            figures = (
                f"| {np.median(after):.1f} m, {after.max():.1f} m "
                f"| {100 * np.median(error):.1f} cm, {100 * error.max():.1f} cm |"
            )
        counts = [states.count("found"), states.count("ambiguous"), states.count("searching")]
        counts.append(seeds - sum(counts))
        print(f"| {world} | {' | '.join(map(str, counts))} {figures}", flush=True)


if __name__ == "__main__":
    main()
