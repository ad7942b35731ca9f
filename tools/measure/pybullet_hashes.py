# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Hash what PyBullet makes of the same drives, to compare versions, forks and Pythons of it.

    python -m tools.measure.pybullet_hashes

Prints: a line a drive with the hashes of its poses, wheel angles, contacts and rays; equal lines are equal bits

Each robot drives for half a minute with commands drawn from a seed, most of them into walls, and casts 800 beams every
0.3 s. docs/simulator.md says what was compared.
"""

from __future__ import annotations

import argparse
import hashlib
import platform
import time

import numpy as np

from testbed.presets import load_robot
from testbed.provenance import versions
from testbed.simulation.physics.backend import AccelerationLimits
from testbed.simulation.physics.pybullet import PyBulletBackend
from worlds import load

WORLDS, ROBOTS = ("office", "apartment", "maze"), ("create3", "burger", "pioneer3dx")
PERIODS, STEPS, PERIODS_OF_COMMAND, PERIODS_OF_SCAN = 600, 12, 20, 6
BEAMS, REACH, HEIGHT = 800, 12.0, 0.2


def main() -> None:
    """Drive and print."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print(f"Python {platform.python_version()}, PyBullet {versions()['pybullet']}")
    for world in WORLDS:
        for robot in ROBOTS:
            print(f"{world:10} {robot:10} {line(world, robot)}")


def line(world: str, robot: str) -> str:
    """Drive a robot; return the hashes, and the time of a scan and of a step [ms]."""
    backend = PyBulletBackend(load(world), load_robot(robot), AccelerationLimits(0.9, 4.0))
    rng = np.random.default_rng(1)
    driven, seen = hashlib.sha256(), hashlib.sha256()
    contacts = 0
    spent = {"scan": 0.0, "step": 0.0}
    for period in range(PERIODS):
        if period % PERIODS_OF_COMMAND == 0:
            command = rng.uniform(-0.3, 0.6), rng.uniform(-1.5, 1.5)
        begun = time.process_time()
        motion = backend.drive(*command, STEPS)
        spent["step"] += (time.process_time() - begun) / (PERIODS * STEPS)
        contacts += motion.contact
        driven.update(motion.poses.tobytes() + motion.wheels.tobytes() + bytes([motion.contact]))
        if period % PERIODS_OF_SCAN == 0:
            x, y, theta = motion.poses[-1]
            directions = theta + np.linspace(0.0, 2.0 * np.pi, BEAMS, endpoint=False)
            begun = time.process_time()
            hits = backend.cast(np.tile([x, y], (BEAMS, 1)), directions, REACH, HEIGHT)
            spent["scan"] += (time.process_time() - begun) / (PERIODS / PERIODS_OF_SCAN)
            for values in hits:
                seen.update(np.ascontiguousarray(values).tobytes())
    backend.close()
    return (
        f"driven {driven.hexdigest()[:12]} ({contacts} contacts), rays {seen.hexdigest()[:12]}; "
        f"{1000 * spent['step']:.3f} ms a step, {1000 * spent['scan']:.2f} ms for {BEAMS} rays"
    )


if __name__ == "__main__":
    main()
