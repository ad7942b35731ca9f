# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Score the exploration strategies in `testbed/Explore-v0`.

    python -m tools.measure.measure_exploration [--worlds 10] [--seeds 5]

Prints: the table of docs/gymnasium.md

Ten held-out worlds, five seeds each; the strategies see the filter's estimate. Takes about ten minutes on an idle core.
"""

import argparse
import sys
from collections import defaultdict
from itertools import product

import gymnasium as gym
import numpy as np

from eval.map.grids import grid_from_true_map
from eval.map.walls import wall_distances
from testbed.envs import GeneratedWorlds
from testbed.exploration import STRATEGIES, make_explorer
from testbed.simulation import DriverConfig

WORLDS = GeneratedWorlds(
    kinds=("rooms", "loops", "cave", "maze", "warehouse"), size=(16.0, 12.0), clutter=0.5, split="test"
)
TIMES = (30, 60, 100, 150)
"""Times of the columns in the table [s]."""


def episode(strategy, world, seed):
    """Coverage and wall error [m] at each of `TIMES`, and the events of the episode."""
    env = gym.make("testbed/Explore-v0", world=WORLDS, coverage=1.0, max_episode_steps=10**9)
    _, info = env.reset(seed=seed, options={"world": world})
    inner = env.unwrapped
    rng = np.random.default_rng(seed)
    explorer = make_explorer(inner.robot_setup.robot, inner.robot_setup.lidar, DriverConfig(strategy=strategy), rng)
    truth = grid_from_true_map(inner.true_map)
    rows, ended, steps = [], False, 0
    for limit in TIMES:
        while not ended and steps * inner.robot_setup.period < limit:
            _, _, ended, _, info = env.step(inner.action(*explorer.command(inner.belief)))
            ended = ended or explorer.finished or explorer.stuck
            steps += 1
        distances = wall_distances(inner.estimated_map, truth, inner.T_world_map, truth.known)
        rows.append((info["coverage"], np.nan if distances is None else distances[0].mean))
    env.close()
    return np.array(rows), {
        "collided": info["collided"], "finished": explorer.finished, "stuck": explorer.stuck,
        "recoveries": explorer.recoveries, "seconds": steps * inner.robot_setup.period,
    }  # fmt: skip


def main():
    """Run all episodes, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=10)
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    rows, events = defaultdict(list), defaultdict(list)
    for seed, world, strategy in product(range(options.seeds), range(options.worlds), STRATEGIES):
        row, event = episode(strategy, world, seed)
        rows[strategy].append(row)
        events[strategy].append(event)
        print(strategy, world, seed, row[:, 0].round(2), row[:, 1].round(3), event, file=sys.stderr, flush=True)
    times = " | ".join(f"{time} s" for time in TIMES)
    print(f"| strategy | {times} | finished | collided | stuck | backed off |")
    print("|---" * (len(TIMES) + 5) + "|")
    for strategy in STRATEGIES:
        means = np.nanmean(rows[strategy], axis=0)
        scores = " | ".join(f"{100 * coverage:.0f} %, {100 * error:.1f} cm" for coverage, error in means)
        found = events[strategy]
        ends = [event["seconds"] for event in found if event["finished"]]
        finished = f"{len(ends)} of {len(found)}" + (f", after {np.mean(ends):.0f} s" if ends else "")
        counts = " | ".join(str(sum(event[name] for event in found)) for name in ("collided", "stuck", "recoveries"))
        print(f"| {strategy} | {scores} | {finished} | {counts} |")


if __name__ == "__main__":
    main()
