# SPDX-License-Identifier: MIT
"""Synthetic datasets: a recording with its truth, the world, and everything needed to make it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eval.files.atomic_write import atomic_directory
from eval.files.map_server import write_map
from eval.files.tum import write_tum
from eval.map.grids import grid_from_true_map
from eval.trajectory.trajectory import Trajectory
from testbed.formats import Log
from testbed.formats.checksums import CONFIG, seal_directory
from testbed.formats.write import write_log
from testbed.simulation import SimulationConfig, simulate
from testbed.simulation.config import CONTROL_PERIOD
from testbed.simulation.drivers.driver import Command
from testbed.simulation.drivers.recorded import RecordedDriver
from testbed.simulation.physics.urdf import robot_urdf
from worlds import World, dumps, true_map

Format = Literal["rosbag2", "rosbag2-lean", "rosbag2-sqlite", "rosbag1", "carmen", "parquet"]

ONE_FILE = {"carmen": ".log.gz", "rosbag1": ".bag"}
"""Formats that are one file, which goes into the dataset's directory."""

MAP_RESOLUTION = 0.05
"""Side of a cell of the true map [m]."""


def is_complete(path: Path) -> bool:
    """Whether a dataset is there: its directory appears under its name only when everything has been written."""
    return (path / CONFIG).is_file()


def write_dataset(
    path: Path,
    world: World,
    config: SimulationConfig,
    settings: Mapping[str, Any],
    *,
    form: Format = "rosbag2",
    commands: Sequence[Command] | None = None,
) -> dict[str, Any]:
    """Simulate a drive and write it as a dataset directory, which must not exist; returns how the drive went.

    It holds the recording (`testbed.formats.write`), world.toml, truth.tum (a pose at every scan), truth_map.pgm and
    .yaml, and config.toml with `settings`, how the drive went, versions and the SHA-256 of all other files. The same
    world and settings give the same bytes. The directory appears when it is whole.

    commands: what the robot is told, instead of the tour
    """
    try:
        with atomic_directory(path) as temporary:
            drive = _write(temporary, world, config, form, commands)
            seal_directory(temporary, {"settings": dict(settings), "drive": drive})
    except FileExistsError:
        if not is_complete(path):  # a worker that outlived its parent may have made it meanwhile: the same bytes
            raise
    return drive


def _write(
    path: Path, world: World, config: SimulationConfig, form: Format, commands: Sequence[Command] | None
) -> dict[str, Any]:
    driver = None if commands is None else RecordedDriver(commands, CONTROL_PERIOD)
    with simulate(world, config, driver) as simulation:
        frames = list(simulation)
    truth_map = grid_from_true_map(true_map(world, MAP_RESOLUTION, height=config.robot.lidar_mount.height))
    log = Log(
        path=path,
        format="simulation",
        frames=frames,
        notes=(),
        truth_map=truth_map,
        robot_urdf=robot_urdf(config.robot),
    )
    if form in ONE_FILE:
        path.mkdir()
        write_log(path / f"{path.name}{ONE_FILE[form]}", log, form)
    else:
        write_log(path, log, form)
    (path / "world.toml").write_text(dumps(world), encoding="utf-8")
    write_map(path / "truth_map.yaml", truth_map)
    known = [(frame.stamp, frame.truth) for frame in frames if frame.scan is not None and frame.truth is not None]
    if not known:
        raise ValueError(f"{path.name}: the drive ended before the first scan was complete, expected a longer duration")
    stamps, poses = zip(*known, strict=True)
    write_tum(path / "truth.tum", Trajectory(np.array(stamps), np.array(poses)))
    return {
        "finished": simulation.finished,
        "stuck": simulation.stuck,
        "collided": simulation.collided,
        "recoveries": simulation.driver.recoveries,
        "seconds": round(simulation.time, 3),
    }
