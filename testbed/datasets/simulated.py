# SPDX-License-Identifier: MIT
"""Synthetic datasets: a recording with its truth, the world, and everything needed to make it again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_directory
from eval.files.map_server import write_map
from eval.files.tum import write_tum
from eval.map.grids import grid_from_true_map
from eval.trajectory.trajectory import Trajectory
from testbed.formats.checksums import CONFIG, seal_directory
from testbed.formats.head import LidarHead, LogHead
from testbed.formats.write import write_blocks
from testbed.frame_table import BLOCK_FRAMES, FrameTable
from testbed.simulation import Simulation, SimulationConfig, simulate
from testbed.simulation.config import CONTROL_PERIOD
from testbed.simulation.drivers.driver import Command
from testbed.simulation.drivers.recorded import RecordedDriver
from testbed.simulation.physics.urdf import robot_urdf
from worlds import World, dumps, true_map

DatasetFormat = Literal["rosbag2", "rosbag2-lean", "rosbag2-sqlite", "rosbag1", "carmen", "parquet"]

ONE_FILE = {"carmen": ".log.gz", "rosbag1": ".bag"}
"""Formats that are one file, which goes into the dataset's directory."""

LICENCE = "cc-by-4.0"
"""Licence of synthetic datasets, as the Hugging Face hub names it."""
MAP_RESOLUTION = 0.05
"""Side of a cell of the true map [m]."""


def is_complete(path: Path) -> bool:
    """Tell whether a dataset exists: its directory appears under its name only when everything has been written."""
    return (path / CONFIG).is_file()


def write_dataset(
    path: Path,
    world: World,
    config: SimulationConfig,
    settings: Mapping[str, Any],
    *,
    log_format: DatasetFormat = "rosbag2",
    commands: Sequence[Command] | None = None,
    draws: Mapping[str, Any] | None = None,
    compressed: bool = False,
) -> dict[str, Any]:
    """Simulate a drive and write it as a dataset directory, which must not exist; returns how the drive went.

    It holds the recording (`testbed.formats.write`), world.toml, truth.tum (a pose at every scan), truth_map.pgm and
    .yaml, and config.toml with `settings`, how the drive went, versions and the SHA-256 of all other files. The same
    world and settings give the same bytes. The directory appears whole or not at all.

    commands: the robot follows these instead of the tour
    draws: settings that were drawn at random, for the index
    compressed: pack the chunks of bags
    """
    try:
        with atomic_directory(path) as temporary:
            drive = _write(temporary, world, config, log_format, commands, compressed)
            document = {"settings": dict(settings), "drive": drive, "world": {"name": world.name}}
            seal_directory(temporary, document | ({"draws": dict(draws)} if draws else {}))
    except FileExistsError:
        if not is_complete(path):  # a worker that outlived its parent may have made it meanwhile: the same bytes
            raise
    return drive


def _write(
    path: Path,
    world: World,
    config: SimulationConfig,
    log_format: DatasetFormat,
    commands: Sequence[Command] | None,
    compressed: bool,
) -> dict[str, Any]:
    driver = None if commands is None else RecordedDriver(commands, CONTROL_PERIOD)
    truth_map = grid_from_true_map(true_map(world, MAP_RESOLUTION, height=config.robot.lidar_mount.height))
    head = LogHead(lidars=_lidars(config), truth_map=truth_map, robot_urdf=robot_urdf(config.robot), licence=LICENCE)
    with simulate(world, config, driver) as simulation:
        drive = _Drive(simulation)
        file = path / f"{path.name}{ONE_FILE[log_format]}" if log_format in ONE_FILE else path
        file.parent.mkdir(exist_ok=True)
        source = {"name": path.name, "format": "simulation"}
        write_blocks(file, drive.blocks(), head, log_format, source=source, compressed=compressed)
    (path / "world.toml").write_text(dumps(world), encoding="utf-8")
    write_map(path / "truth_map.yaml", truth_map)
    write_tum(path / "truth.tum", drive.truth_at_scans(path.name))
    return {
        "finished": simulation.finished,
        "stuck": simulation.stuck,
        "collided": simulation.collided,
        "recoveries": simulation.driver.recoveries,
        "seconds": round(simulation.time, 3),
        "metres": round(drive.metres, 3),
        "scans": drive.scans,
    }


def _lidars(config: SimulationConfig) -> dict[str, LidarHead]:
    presets = (config.lidar, *config.further_lidars)
    return {
        mount.name: LidarHead(
            mount=mount.pose, range_max=preset.range_max, scan_time=1.0 / preset.scan_rate, model=preset.name
        )
        for preset, mount in zip(presets, config.robot.lidar_mounts, strict=False)
    }


class _Drive:
    """A drive in blocks of frames, of which one is in memory at a time; keeps what is said of the whole."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._stamps: list[NDArray[np.float64]] = []
        self._poses: list[NDArray[np.float64]] = []
        self.metres = 0.0
        """Length of the true path so far [m]."""
        self.scans = 0

    def blocks(self) -> Iterator[FrameTable]:
        """The frames of the drive."""
        last = np.empty((0, 2))
        for block in self._simulation.blocks(BLOCK_FRAMES):
            yield block
            path = np.concatenate([last, block.truth[:, :2]])
            self.metres += float(np.hypot(*np.diff(path, axis=0).T).sum())
            self.scans += len(block.scan_rows)
            self._stamps.append(block.stamps[block.scan_rows])
            self._poses.append(block.truth[block.scan_rows])
            last = path[-1:]

    def truth_at_scans(self, name: str) -> Trajectory:
        """The true poses at the scans; ValueError where there are none."""
        if not self.scans:
            raise ValueError(f"{name}: the drive ended before the first scan was complete, expected a longer duration")
        return Trajectory(np.concatenate(self._stamps), np.concatenate(self._poses))
