# SPDX-License-Identifier: MIT
"""Compilation of all kernels before the first run, in a process of its own that Ctrl-C can end at any time.

The machine code is kept on disk (`slam._kernel_cache`), so that the work is done once per version. `python -m
testbed.kernels` is that process.
"""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import slam
from slam._kernel_cache import cache_folder, kernel_files

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from slam.config import FilterConfig
    from slam.gmapping import GMapping
    from slam.scan import Scan

PACKAGES = (Path(slam.__file__).parent, Path(__file__).parent)
"""Packages with kernels."""


def is_compiled() -> bool:
    """Whether all kernels of this installation are on disk, or no disk cache is in use at all."""
    if os.environ.get("SLAM_KERNEL_CACHE", "1") != "1":
        return True
    marks = [_mark(package) for package in PACKAGES]
    return all(mark is None or mark.exists() for mark in marks)


def compile_kernels(news: Callable[[int, int], None] | None = None) -> float:
    """Compile all kernels, unless they are on disk already; returns the time it took [s].

    news: called about once a second with the number of kernels that were compiled, and of all

    Raises OSError, with the last line of what that process said, where it fails, such as on a full disk.
    """
    start, since = time.perf_counter(), time.time()
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen([sys.executable, "-m", "testbed.kernels"], stderr=said)
        try:
            while process.poll() is None:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(1.0)
                if news is not None:
                    news(*_compiled_since(since))
        finally:
            process.kill()
            process.wait()
        said.seek(0)
        lines = said.read().strip().splitlines()
    if process.returncode != 0:
        raise OSError(f"the kernels could not be compiled: {(lines or [f'exit status {process.returncode}'])[-1]}")
    return time.perf_counter() - start


def _compiled_since(since: float) -> tuple[int, int]:
    """How many kernels were written to the disk after a time [s since 1970], and how many there are."""
    sources = [source.read_text(encoding="utf-8") for package in PACKAGES for source in kernel_files(package)]
    total = sum(f"\n{text}".count("\n@kernel\n") for text in sources)
    folders = filter(None, map(cache_folder, PACKAGES))
    fresh = sum(file.stat().st_mtime >= since for folder in folders for file in folder.rglob("*.nbi"))
    return min(fresh, total), total


def exercise_kernels() -> None:
    """Call every kernel with its usual types, then note that all of them are on disk."""
    _map_a_room()
    _drive_through_a_room()
    _drive_a_fleet()
    _step_the_exploration()
    for package in PACKAGES:
        if (mark := _mark(package)) is not None:
            mark.touch()


def _mark(package: Path) -> Path | None:
    """File that says that all kernels of a package were compiled to the end; None where they cannot be kept.

    Some machine code on disk says less: a compilation may have been cut off, and numba compiles again for the same
    sources in another place or with another time of change, such as those of a second installation.
    """
    digest = hashlib.sha256()
    for source in kernel_files(package.resolve()):
        status = source.stat()
        digest.update(f"{source} {status.st_mtime_ns} {status.st_size}\n".encode())
    folder = cache_folder(package)
    return None if folder is None else folder / f"compiled-{digest.hexdigest()[:16]}"


def _map_a_room() -> None:
    """Map a small room from six poses, show it, refine it, localise and explore in it."""
    from slam.config import FilterConfig, ResampleConfig
    from slam.diagnosis.path_check import left_out_score
    from slam.gmapping import GMapping
    from slam.localization import Localization
    from slam.refinement import refine
    from slam.scan import Scan
    from slam.sensor.rays import make_rays
    from testbed.views.map_cells import map_cells
    from testbed.views.rerun.layers.comparison import COARSE, most_different
    from testbed.views.rerun.layers.map_tiles import ImagePool, MapTiles

    angles = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    with np.errstate(divide="ignore"):
        ranges = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    ranges[:10] = 10.0  # a gap: somewhere to explore
    scan = Scan(ranges=ranges, angles=angles, range_max=10.0)
    config = FilterConfig(particles=4, resample=ResampleConfig(when="always"))
    odometry = np.array([[0.2 * k, 0.0, 0.0] for k in range(6)])  # more poses than the histories have room for at first
    mapper = GMapping(config)
    for pose in odometry:
        mapper.process(pose, scan)
    path = mapper.path()
    turned = replace(scan, ranges=np.roll(ranges, 10))  # of which the wheels say nothing: the search becomes wide
    mapper.process(odometry[-1] + (0.2, 0.0, 0.0), turned)
    for coarse in (1, COARSE):
        MapTiles(ImagePool(0), coarse).changes(map_cells(mapper.maps, mapper.best))
    most_different(map_cells(mapper.maps, mapper.best), mapper.best)
    refine(odometry, [scan] * len(odometry), path, config)
    _match_local_maps(odometry, scan, config)
    left_out_score(path, [make_rays([scan], usable_range=10.0)] * len(path), config.map)
    for start in (odometry[0], None):
        Localization(mapper.map(), config, start=start).process(odometry[0], scan)
    _explore(mapper, scan)


def _match_local_maps(odometry: NDArray[np.float64], scan: Scan, config: FilterConfig) -> None:
    """Match a local map to itself, as is done to find loops."""
    from slam._threads import Threads
    from slam.loops.correlative_match import prepare, refine_pose, search_window
    from slam.loops.local_maps import track_locally
    from slam.sensor.rays import make_rays

    threads, rays = Threads(1), make_rays([scan], usable_range=config.map.usable_range)
    local = track_locally(odometry, odometry, dict.fromkeys(range(len(odometry)), rays), config, threads).maps[0]
    searched = prepare(local, config.map.cell)
    search_window(searched, searched, np.zeros(3), 0.5, 0.1)
    refine_pose(searched, searched, np.zeros(3), config, threads)


def _explore(mapper: GMapping, scan: Scan) -> None:
    """Ask the exploring driver for one command."""
    from testbed.exploration import Belief, make_explorer
    from testbed.presets import load_lidar, load_robot
    from testbed.simulation import DriverConfig

    driver = DriverConfig(strategy="information")
    explorer = make_explorer(load_robot("create3"), load_lidar("rplidar_a2"), driver, np.random.default_rng(0))
    explorer.command(Belief(stamp=0.0, pose=mapper.poses[0], scans=(scan,), map=mapper.map))


def _drive_through_a_room() -> None:
    """Simulate a quarter of a second in a small room that holds everything that a kernel is for, and without people."""
    from testbed.simulation import SimulationConfig, simulate
    from worlds import Door, Person, Start, Tour, Wall, World

    room = World(
        name="warm-up",
        start=Start(x=1.0, y=1.0),
        tour=Tour(points=[(5.0, 1.0)]),
        walls=[Wall(name="walls", points=[(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)], closed=True)],
        people=[Person(name="person", points=[(1.0, 4.0), (5.0, 4.0)])],
        doors=[Door(name="door", x=3.0, y=5.9, closed=0.0, swing=1.5)],
    )
    deserted = room.model_copy(update={"people": [], "doors": []})  # several control periods are then one call
    for world in (room, deserted):
        for _ in simulate(world, SimulationConfig(backend="fast", duration=0.25)):
            pass


def _drive_a_fleet() -> None:
    """Take one step with two robots of the vectorised environment."""
    from testbed.envs.drive_vector import DriveVectorEnv

    envs = DriveVectorEnv(num_envs=2)
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    envs.close()


def _step_the_exploration() -> None:
    """Take one step of the exploration environment."""
    from testbed.envs.explore import ExploreEnv

    env = ExploreEnv()
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a terminal sends Ctrl-C to this process too: it ends silently
    exercise_kernels()
