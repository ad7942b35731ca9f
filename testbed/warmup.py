# SPDX-License-Identifier: MIT
"""Compilation of the kernels ahead of the first run, in a process of its own that Ctrl-C can end at any time.

The machine code is kept on disk (`slam._jit`), so that the work is done once per version. `python -m testbed.warmup`
is that process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import slam
from slam._jit import cache_folder


def is_compiled() -> bool:
    """Whether kernels of this version are on disk, or no disk cache is in use at all."""
    if os.environ.get("SLAM_KERNEL_CACHE", "1") != "1":
        return True
    packages = (Path(slam.__file__).parent, Path(__file__).parent / "simulation")
    return all(any(cache_folder(package).rglob("*.nbc")) for package in packages)


def compile_kernels() -> float:
    """Compile all kernels, unless they are on disk already; returns the time it took [s]."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "testbed.warmup"], check=True)
    return time.perf_counter() - start


def exercise_kernels() -> None:
    """Call every kernel with its usual types."""
    from testbed.simulation.warm_up import warm_up

    _map_a_room()
    warm_up()


def _map_a_room() -> None:
    """Map a small room from four poses and refine it."""
    from slam.config import FilterConfig, ResampleConfig
    from slam.final_pass import refine
    from slam.gmapping import GMapping
    from slam.scan import Scan

    angles = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    with np.errstate(divide="ignore"):
        ranges = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    scan = Scan(ranges=ranges, angles=angles, range_max=10.0)
    config = FilterConfig(particles=4, resample=ResampleConfig(when="always"))
    odometry = np.array([[0.3 * k, 0.0, 0.0] for k in range(4)])
    mapper = GMapping(config)
    for pose in odometry:
        mapper.process(pose, scan)
    mapper.map()
    refine(odometry, [scan] * len(odometry), mapper.path(), config)


if __name__ == "__main__":
    exercise_kernels()
