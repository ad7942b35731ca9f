# SPDX-License-Identifier: MIT
"""Synthetic datasets: a recording with its truth, the world, and everything needed to make it again."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eval.grids import true_grid
from eval.map_server import write_map
from eval.trajectory import Trajectory
from eval.tum import write_tum
from testbed.formats.carmen_writer import write_carmen
from testbed.formats.checksums import CONFIG, checksums_of
from testbed.formats.ros_bag_writer import write_bag
from testbed.provenance import dump_toml, versions
from testbed.simulation import SimulationConfig, simulate
from testbed.simulation.urdf import robot_urdf
from worlds import World, dumps, true_map

Format = Literal["rosbag2", "rosbag2-lean", "carmen"]

MAP_RESOLUTION = 0.05
"""Side of a cell of the true map [m]."""


def is_complete(path: Path) -> bool:
    """Whether a dataset is there: its directory appears under its name only when everything has been written."""
    return (path / CONFIG).is_file()


def write_dataset(
    path: Path, world: World, config: SimulationConfig, settings: Mapping[str, Any], *, form: Format = "rosbag2"
) -> None:
    """Simulate a drive and write it as a dataset directory, which must not exist.

    It holds the recording (`rosbag2`: metadata.yaml and one .mcap that ROS 2 plays and Rerun shows; `rosbag2-lean`:
    the same in half the space, without `/scan_cloud`, which is what Rerun draws of scans; `carmen`: one .log.gz),
    world.toml, truth.tum (a pose at every scan), truth_map.pgm and .yaml, and config.toml with `settings`, versions and
    the SHA-256 of all other files. The same world and settings give the same bytes. Written aside and renamed.
    """
    discard_unfinished(path)
    aside = _aside(path)
    aside.parent.mkdir(parents=True)
    try:
        _write(aside, world, config, form)
        document = {"settings": dict(settings), "versions": versions(), "checksums": checksums_of(aside)}
        (aside / CONFIG).write_text(dump_toml(document), encoding="utf-8")
        aside.replace(path)
    finally:
        discard_unfinished(path)


def discard_unfinished(path: Path) -> None:
    """Remove what a writer of this dataset has left that was killed."""
    shutil.rmtree(_aside(path).parent, ignore_errors=True)


def _aside(path: Path) -> Path:
    """Where the dataset is while it is written: a folder of its own, since its files are named after the last part."""
    return path.parent / f".{path.name}.simulating" / path.name


def _write(path: Path, world: World, config: SimulationConfig, form: Format) -> None:
    with simulate(world, config) as simulation:
        frames = list(simulation)
    truth_map = true_grid(true_map(world, MAP_RESOLUTION, height=config.robot.lidar_mount.height))
    if form == "carmen":
        path.mkdir()
        write_carmen(path / f"{path.name}.log.gz", frames)
    else:
        cloud = form == "rosbag2"
        write_bag(path, frames, truth_map=truth_map, robot_urdf=robot_urdf(config.robot), cloud=cloud)
    (path / "world.toml").write_text(dumps(world), encoding="utf-8")
    write_map(path / "truth_map.yaml", truth_map)
    known = [(frame.stamp, frame.truth) for frame in frames if frame.scan is not None and frame.truth is not None]
    stamps, poses = zip(*known, strict=True)
    write_tum(path / "truth.tum", Trajectory(np.array(stamps), np.array(poses)))
