# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure the simulator's speed (CPU time of one core) and memory.

    python -m tools.measure.measure_simulator

Prints: the figures under "Speed and memory" in docs/simulator.md

Use an idle machine. Takes about three minutes.
"""

import argparse
import resource
import time

import numpy as np

import worlds
from testbed.presets import load_lidar
from testbed.simulation import SimulationConfig, simulate
from testbed.simulation.physics._ray_kernels import cast_rays
from testbed.simulation.physics.fast import segment_grid

LIDAR = load_lidar("rplidar_a2").model_copy(update={"beams": 360})


def world_of_500_walls() -> worlds.World:
    """Generate rooms with clutter, 30 m x 24 m: 545 segments."""
    return worlds.generate("rooms", size=(30.0, 24.0), clutter=0.35, seed=1)


def rays() -> None:
    """Print the rays per second of the segment grid, cast from points on the tour."""
    world = world_of_500_walls()
    segments = world.boundary_segments(0.2)
    grid, places = segment_grid(segments), world.path()[::3]
    for beams, reach in ((360, 10.0), (1080, 30.0)):
        directions = np.linspace(-np.pi, np.pi, beams, endpoint=False)
        cast_rays(grid, np.repeat(places[:1], beams, axis=0), directions, reach)
        begin = time.process_time()
        for _ in range(20):
            for place in places:
                cast_rays(grid, np.repeat(place[None], beams, axis=0), directions, reach)
        rate = 20 * len(places) * beams / (time.process_time() - begin)
        print(f"segment grid, {len(segments)} segments, {beams} beams, {reach:g} m: {rate / 1e6:.1f} million rays/s")


def whole_loop(backend: str, seconds: float) -> None:
    """Print the simulated seconds per second with all noise on."""
    config = SimulationConfig(backend=backend, lidar=LIDAR, duration=seconds)  # type: ignore[arg-type]
    with simulate(world_of_500_walls(), config) as simulation:
        next(simulation)
        begin = time.process_time()
        for _ in simulation:
            pass
    print(f"{backend}: {seconds / (time.process_time() - begin):.0f} simulated seconds per second")


def memory(backend: str, runs: int) -> None:
    """Print how much the process grows over many short simulations."""
    world, config = worlds.load("loop"), SimulationConfig(backend=backend, lidar=LIDAR, duration=0.2)  # type: ignore[arg-type]
    before = 0
    for run in range(runs + 5):
        if run == 5:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for _ in simulate(world, config):
            pass
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(f"{backend}: peak memory grows by {grown:.0f} MB over {runs} simulations in one process")


def main() -> None:
    """Print all figures."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rays()
    whole_loop("fast", 120.0)
    whole_loop("pybullet", 30.0)
    memory("fast", 1000)
    memory("pybullet", 1000)


if __name__ == "__main__":
    main()
