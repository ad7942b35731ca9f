# SPDX-License-Identifier: MIT
"""Compilation of the kernels ahead of the first run, in a process of its own that Ctrl-C can end at any time.

The machine code is kept on disk (`slam._jit`), so that the work is done once per version. `python -m testbed.kernels`
is that process.
"""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import slam
from slam._jit import cache_folder

PACKAGES = (Path(slam.__file__).parent, Path(__file__).parent / "simulation")
"""Packages with kernels."""


def is_compiled() -> bool:
    """Whether all kernels of this installation are on disk, or no disk cache is in use at all."""
    return os.environ.get("SLAM_KERNEL_CACHE", "1") != "1" or all(_mark(package).exists() for package in PACKAGES)


def compile_kernels() -> float:
    """Compile all kernels, unless they are on disk already; returns the time it took [s].

    Raises OSError, with the last line of what that process said, where it fails, such as on a full disk.
    """
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "testbed.kernels"], stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        raise OSError(f"the kernels could not be compiled: {reason}")
    return time.perf_counter() - start


def exercise_kernels() -> None:
    """Call every kernel with its usual types, then note that all of them are on disk."""
    from testbed.simulation.warm_up import warm_up

    _map_a_room()
    warm_up()
    for package in PACKAGES:
        _mark(package).touch()


def _mark(package: Path) -> Path:
    """File that says that all kernels of a package were compiled to the end.

    Some machine code on disk says less: a compilation may have been cut off, and numba compiles again for the same
    sources in another place or with another time of change, such as those of a second installation.
    """
    digest = hashlib.sha256()
    for source in sorted(package.resolve().glob("_*_kernels.py")):
        status = source.stat()
        digest.update(f"{source} {status.st_mtime_ns} {status.st_size}\n".encode())
    return cache_folder(package) / f"compiled-{digest.hexdigest()[:16]}"


def _map_a_room() -> None:
    """Map a small room from four poses, refine it, find the robot in it."""
    from slam.config import FilterConfig, ResampleConfig
    from slam.gmapping import GMapping
    from slam.localization import Localization
    from slam.refinement import refine
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
    grid = mapper.map()
    refine(odometry, [scan] * len(odometry), mapper.path(), config)
    for start in (odometry[0], None):
        Localization(grid, config, start=start).process(odometry[0], scan)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a terminal sends Ctrl-C to this process too: it ends without a word
    exercise_kernels()
