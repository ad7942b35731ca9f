# SPDX-License-Identifier: MIT
"""What a twin is made from: a log, the path of its robot, and its final map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.files.run_reader import read_run
from eval.files.tum import read_tum
from slam.config import FilterConfig
from slam.motion.continuous_odometry import join_odometry
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.estimation.estimation import Estimation
from testbed.formats import Log, LogError
from testbed.inspect import Reading
from testbed.run.execute import RunProgress
from testbed.seeds import RunSeeds


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstruction:
    """A log with the estimated path and map."""

    log: Log
    """The recording."""
    odometry: Pose
    """`T_odom_robot` at each scan, joined where it started again, in the order of the file, (m, 3)."""
    path: Pose
    """Estimated `T_map_robot` at each scan after the final pass, (m, 3)."""
    stamps: NDArray[np.float64]
    """Increasing times of frames, with scan or without [s], (n,)."""
    dense_path: Pose
    """Estimated `T_map_robot` at these times, (n, 3)."""
    grid: OccupancyGrid
    """The final map."""

    @classmethod
    def of(cls, log: Log, path: Pose, grid: OccupancyGrid) -> Reconstruction:
        """Put together a log, the path at all of its frames (n, 3), and the map. Raises LogError for too few frames."""
        table, kept = log.table, _increasing(log.table.stamps)
        if kept.sum() < 2 or log.scan_count < 2:
            raise LogError(f"{log.path}: expected at least two scans at different times to make a twin of")
        return cls(
            log=log,
            odometry=join_odometry(table.stamps, table.odometry)[table.scan_rows],
            path=path[table.scan_rows],
            stamps=table.stamps[kept],
            dense_path=path[kept],
            grid=grid,
        )


def read_reconstruction(run: Path) -> Reconstruction:
    """Read what a run directory of `testbed slam` holds, with the log that it names.

    Raises ValueError, naming the file, where it is no finished run of a log.
    """
    files = read_run(run)
    settings = files.config.get("settings", {})
    if "log" not in settings:
        raise ValueError(f"{run}: config.toml names no log, expected a run of testbed slam")
    if settings.get("map") is not None:
        raise ValueError(f"{run}: a localisation in a finished map, expected a run that made a map")
    if files.grid is None or not (run / "estimate_dense.tum").is_file():
        raise ValueError(f"{run}: expected map.yaml and estimate_dense.tum of a finished run")
    log = Reading.from_settings(settings).open(Path(settings["log"]))
    dense = read_tum(run / "estimate_dense.tum")
    if len(dense) != len(log.table):
        raise ValueError(f"{run}: estimate_dense.tum has {len(dense)} poses, {log.path} has {len(log.table)} frames")
    return Reconstruction.of(log, dense.poses, files.grid)


def reconstruct(
    log: Log, config: FilterConfig, seeds: RunSeeds, watcher: RunProgress, *, threads: int | None = None
) -> Reconstruction:
    """Map a log with the particle filter and the final pass."""
    watcher.stage("mapping")
    estimation = Estimation(config, seeds.filter, threads)
    for number, frame in enumerate(log.frames, start=1):
        if estimation.process(frame) is not None:
            watcher.step(frame.stamp, number / len(log.table), None)
    watcher.stage("final pass")

    def watch(share: float) -> bool:
        watcher.share(share)
        return True

    estimate = estimation.refined(estimation.filtered(), watch)
    return Reconstruction.of(log, estimate.dense.poses, estimate.map)


def _increasing(stamps: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which stamps (n,) are later than all before them, (n,)."""
    latest = np.maximum.accumulate(stamps)
    increasing: NDArray[np.bool_] = np.append(True, stamps[1:] > latest[:-1])
    return increasing
