# SPDX-License-Identifier: MIT
"""Compilation of all kernels before the first run, in two processes of its own that Ctrl-C can end at any time.

The machine code is kept on disk (`slam._kernel_cache`), so that the work is done once per version. `python -m
testbed.kernels PART` is such a process.
"""

from __future__ import annotations

import fcntl
import gc
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
from typing import IO, TYPE_CHECKING

import numpy as np

import slam
from slam._kernel_cache import cache_folder, kernel_files
from slam._threads import core_count

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from slam.config import FilterConfig
    from slam.gmapping import GMapping
    from slam.scan import Scan

PACKAGES = (Path(slam.__file__).parent, Path(__file__).parent)
"""Packages with kernels."""
PERIOD = 1.0
"""Time between two looks at what was compiled [s]."""


def is_compiled() -> bool:
    """Whether all kernels of this installation are on disk, or no disk cache is in use at all."""
    if os.environ.get("SLAM_KERNEL_CACHE", "1") != "1":
        return True
    marks = [_mark(package) for package in PACKAGES]
    return all(mark is None or mark.exists() for mark in marks)


def compile_kernels(news: Callable[[int, int], None] | None = None) -> float:
    """Compile all kernels, unless they are on disk already; returns the time it took [s].

    Where another process compiles them, wait for it: two at once would do the same work twice.

    news: called about once a second with the number of kernels that were compiled, and of all

    Raises OSError, with the last line of what that process said, where it fails, such as on a full disk.
    """
    start, folder = time.perf_counter(), cache_folder(PACKAGES[0])
    if folder is None:
        _compile(time.time(), news)
        return time.perf_counter() - start
    with (folder / "compiling").open("a") as turn:
        while not _take(turn):
            time.sleep(PERIOD)
            if news is not None:
                news(*_compiled_since(os.fstat(turn.fileno()).st_mtime))
        if not is_compiled():
            os.utime(turn.fileno())
            _compile(os.fstat(turn.fileno()).st_mtime, news)
    return time.perf_counter() - start


def _take(turn: IO[str]) -> bool:
    """Whether it is this process's turn; it is until the file is closed."""
    try:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _compile(since: float, news: Callable[[int, int], None] | None) -> None:
    """Compile all kernels in processes of their own, that began at a time [s since 1970]; see `compile_kernels`."""
    running: list[_Worker] = []
    try:
        for parts in _shares():
            running.append(_Worker(parts))
        while at_work := [worker for worker in running if worker.runs()]:
            at_work[0].wait(PERIOD)
            if news is not None:
                news(*_compiled_since(since))
    finally:
        for worker in running:
            worker.stop()
    _note_that_all_are_compiled()


def _shares() -> list[list[str]]:
    """The parts that each process compiles: one each where there are two cores, else one process all of them."""
    return [[part] for part in PARTS] if core_count() > 1 else [list(PARTS)]


class _Worker:
    """A process that compiles some of the `PARTS`."""

    def __init__(self, parts: list[str]) -> None:
        self._said = tempfile.TemporaryFile("w+")  # noqa: SIM115  until `stop`
        self._process = subprocess.Popen([sys.executable, "-m", "testbed.kernels", *parts], stderr=self._said)

    def runs(self) -> bool:
        """Whether the process is still at work.

        Raises OSError, with the last line that it said, where it has failed.
        """
        status = self._process.poll()
        if status is not None and status != 0:
            self._said.seek(0)
            lines = self._said.read().strip().splitlines()
            raise OSError(f"the kernels could not be compiled: {(lines or [f'exit status {status}'])[-1]}")
        return status is None

    def wait(self, seconds: float) -> None:
        """Wait until the process has ended, but at most so long [s]."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)

    def stop(self) -> None:
        """End the process where it has not ended."""
        self._process.kill()
        self._process.wait()
        self._said.close()


def _compiled_since(since: float) -> tuple[int, int]:
    """How many kernels were written to the disk after a time [s since 1970], and how many there are."""
    sources = [source.read_text(encoding="utf-8") for package in PACKAGES for source in kernel_files(package)]
    total = sum(f"\n{text}".count("\n@kernel\n") for text in sources)
    folders = filter(None, map(cache_folder, PACKAGES))
    fresh = sum(file.stat().st_mtime >= since for folder in folders for file in folder.rglob("*.nbi"))
    return min(fresh, total), total


def exercise_kernels() -> None:
    """Call every kernel with its usual types, then note that all of them are on disk."""
    for exercise in PARTS.values():
        exercise()
    _note_that_all_are_compiled()


def _note_that_all_are_compiled() -> None:
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


def _exercise_mapping() -> None:
    """Call the kernels of the filter, and those that read its maps."""
    scan, config, odometry = _scan_of_a_room(), _config(), _short_path()
    mapper = _map_a_room(scan, config, odometry)
    _show(mapper)
    _match_local_maps(odometry, scan, config)
    _check(odometry, scan, config)
    _localise(mapper, scan, config, odometry)
    _explore(mapper, scan)


def _exercise_the_rest() -> None:
    """Call the kernels of the simulation and of the final pass, which need no filter."""
    _drive_through_a_room()
    _drive_a_fleet()
    _refine_a_path()


PARTS = {"mapping": _exercise_mapping, "rest": _exercise_the_rest}
"""Parts of the kernels, of about the same size, that have next to none in common: each is compiled in a process."""


def _scan_of_a_room() -> Scan:
    """Scan from the middle of a square room of 4 m, with a gap: somewhere to explore."""
    from slam.scan import Scan

    angles = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    with np.errstate(divide="ignore"):
        ranges = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    ranges[:10] = 10.0
    return Scan(ranges=ranges, angles=angles, range_max=10.0)


def _short_path() -> NDArray[np.float64]:
    """Six poses (6, 3): more than the filter's histories have room for at first."""
    return np.array([[0.2 * k, 0.0, 0.0] for k in range(6)])


def _config() -> FilterConfig:
    """Settings under which every step does all that it can do."""
    from slam.config import FilterConfig, ResampleConfig

    return FilterConfig(particles=4, resample=ResampleConfig(when="always"))


def _map_a_room(scan: Scan, config: FilterConfig, odometry: NDArray[np.float64]) -> GMapping:
    """Map a small room from the poses of a path (n, 3), and from one of which the wheels say nothing."""
    from slam.gmapping import GMapping

    mapper = GMapping(config)
    for pose in odometry:
        mapper.process(pose, scan)
    mapper.path()
    turned = replace(scan, ranges=np.roll(scan.ranges, 10))  # the search becomes wide
    mapper.process(odometry[-1] + (0.2, 0.0, 0.0), turned)
    return mapper


def _show(mapper: GMapping) -> None:
    """Draw the maps as the viewer does."""
    from testbed.views.map_cells import map_cells
    from testbed.views.rerun.layers.comparison import COARSE, most_different
    from testbed.views.rerun.layers.map_tiles import ImagePool, MapTiles

    for coarse in (1, COARSE):
        MapTiles(ImagePool(0), coarse).changes(map_cells(mapper.maps, mapper.best))
    most_different(map_cells(mapper.maps, mapper.best), mapper.best)


def _check(path: NDArray[np.float64], scan: Scan, config: FilterConfig) -> None:
    """Check a path (n, 3) against the scans along it."""
    from slam.diagnosis.path_check import left_out_score
    from slam.sensor.rays import make_rays

    left_out_score(path, [make_rays([scan], usable_range=10.0)] * len(path), config.map)


def _localise(mapper: GMapping, scan: Scan, config: FilterConfig, odometry: NDArray[np.float64]) -> None:
    """Localise in a finished map, from a known pose and from none."""
    from slam.localization import Localization

    for start in (odometry[0], None):
        Localization(mapper.map(), config, start=start).process(odometry[0], scan)


def _refine_a_path() -> None:
    """Run the final pass on a short path, without a search for loops, which is the filter's work."""
    from slam.refinement import refine

    odometry, config = _short_path(), _config()
    without_loops = replace(config, refine=replace(config.refine, close_loops=False))
    refine(odometry, [_scan_of_a_room()] * len(odometry), odometry, without_loops)


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
    """Ask the exploring driver for one command, and show and score the map as the exploration environment does."""
    from testbed.envs.observation.egocentric import Crop
    from testbed.envs.observation.map_score import MapScore
    from testbed.exploration import Belief, make_explorer
    from testbed.presets import load_lidar, load_robot
    from testbed.simulation import DriverConfig
    from worlds.raster import TrueMap

    driver, grid, pose = DriverConfig(strategy="information"), mapper.map(), mapper.poses[0]
    explorer = make_explorer(load_robot("create3"), load_lidar("rplidar_a2"), driver, np.random.default_rng(0))
    explorer.command(Belief(stamp=0.0, pose=pose, scans=(scan,), map=mapper.map))
    Crop().cut(grid, pose)
    truth = TrueMap(occupied=grid.occupied, free=grid.free, resolution=grid.resolution, origin=grid.origin)
    MapScore(truth).mapped(grid, np.zeros(3))


def _drive_through_a_room() -> None:
    """Simulate a quarter of a second in a small room that holds everything that a kernel is for, and without people."""
    from testbed.simulation import SimulationConfig, SurfaceConfig, simulate
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
        for _ in simulate(
            world, SimulationConfig(backend="fast", duration=0.25, surface=SurfaceConfig(roughness=0.01))
        ):
            pass


def _drive_a_fleet() -> None:
    """Take one step with two robots of the vectorised environment."""
    from testbed.envs.drive_vector import DriveVectorEnv

    envs = DriveVectorEnv(num_envs=2)
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    envs.close()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a terminal sends Ctrl-C to this process too: it ends silently
    gc.freeze()  # compiling makes many objects and little garbage: looking for it took a tenth of the time
    gc.set_threshold(100_000, 20, 100)
    for part in sys.argv[1:]:
        PARTS[part]()
