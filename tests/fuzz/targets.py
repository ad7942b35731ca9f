# SPDX-License-Identifier: MIT
"""The readers that are fuzzed, what each of them may say of a wrong file, and sound files to begin with."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import worlds
from eval.files.trajectory_file import read_trajectory
from eval.trajectory.relations import read_relations
from slam.checkpoint import load_checkpoint, save_checkpoint
from slam.config import FilterConfig
from slam.gmapping import GMapping
from testbed.formats import Log, open_log
from testbed.formats.commands import read_commands
from testbed.formats.write import write_log
from testbed.presets import load_lidar, load_robot
from testbed.sweep.spec.spec import read_document
from tests.testbed.recordings import two_lidar_drive
from worlds.format.map_file import read_map_file

MAX_MESSAGE = 1000
"""Largest number of characters of a complaint."""
MAP = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"


@dataclass(frozen=True)
class Target:
    """A reader, the name of the file that is fuzzed, and a maker of a sound one."""

    file: str
    read: Callable[[Path], Any]
    write_sound: Callable[[Path], None]


def read_log(path: Path) -> Log:
    """Read a recording; nothing in it may be infinite or NaN but ranges."""
    log = open_log(path, scans_needed=False)
    for name in ("stamps", "odometry", "mounts"):
        assert np.isfinite(getattr(log.table, name)).all(), f"{name} that are not finite"
    return log


def write_part(suffix: str, log_format: str) -> Callable[[Path], None]:
    """A maker of the one file of that suffix among those of a format."""

    def write(path: Path) -> None:
        folder = path.with_name("whole")
        write_log(folder, two_lidar_drive(), log_format)  # type: ignore[arg-type]
        shutil.move(next(folder.glob(f"*{suffix}")), path)
        shutil.rmtree(folder)

    return write


def write_text(text: str) -> Callable[[Path], None]:
    """A maker of a text file."""
    return lambda path: path.write_text(text, encoding="utf-8") and None


def write_checkpoint(path: Path) -> None:
    """Save a filter that has seen one scan."""
    frame = next(frame for frame in two_lidar_drive().frames if frame.scan is not None)
    mapper = GMapping(FilterConfig(particles=2), seed=0)
    mapper.process(frame.odometry, [frame.scan])
    save_checkpoint(mapper, path)


def write_image(path: Path) -> None:
    """Draw a small map."""
    from PIL import Image

    pixels = np.full((6, 5), 254, dtype=np.uint8)
    pixels[2, 1:4], pixels[4] = 0, 205
    Image.fromarray(pixels).save(path)


def read_image(path: Path) -> Any:
    """Read a map whose picture is fuzzed; the description stands beside it."""
    description = path.with_name("map.yaml")
    description.write_text(MAP.replace("map.pgm", path.name), encoding="utf-8")
    return read_map_file(description)


def read_description(path: Path) -> Any:
    """Read a map whose description is fuzzed; the picture stands beside it."""
    if not path.with_name("map.pgm").exists():
        write_image(path.with_name("map.pgm"))
    return read_map_file(path)


WORLD = """name = "room"
[start]
x = 1.0
y = 1.0
[tour]
points = [[1.0, 1.0], [3.0, 1.0], [3.0, 3.0]]
closed = true
laps = 2
[[walls]]
points = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]]
"""
TUM = "# stamp x y z qx qy qz qw\n0.0 0 0 0 0 0 0 1\n0.5 0.1 0 0 0 0 0.1 0.995\n1.0 0.2 0.1 0 0 0 0.2 0.98\n"
RELATIONS = "0.0 1.0 0.5 0.1 0 0 0 0.3\n1.0 2.0 0.5 -0.1 0 0 0 -0.3\n"
SWEEP = 'name = "s"\nworlds = ["office", "generated:rooms*3"]\nseeds = 4\nparticles = [1, 5]\n'
COMMANDS = "stamp,speed,turn_rate\n0.0,0.1,0.0\n0.5,0.2,0.3\n"

TARGETS = {
    "carmen": Target("drive.log", read_log, lambda path: write_log(path, two_lidar_drive(), "carmen")),
    "carmen_gz": Target("drive.log.gz", read_log, lambda path: write_log(path, two_lidar_drive(), "carmen")),
    "mcap": Target("drive.mcap", read_log, write_part(".mcap", "rosbag2-lean")),
    "db3": Target("drive.db3", read_log, write_part(".db3", "rosbag2-sqlite")),
    "bag": Target("drive.bag", read_log, lambda path: write_log(path, two_lidar_drive(), "rosbag1")),
    "parquet": Target("drive.parquet", read_log, write_part(".parquet", "parquet")),
    "tum": Target("path.tum", read_trajectory, write_text(TUM)),
    "relations": Target("pairs.relations", read_relations, write_text(RELATIONS)),
    "pgm": Target("map.pgm", read_image, write_image),
    "png": Target("map.png", read_image, write_image),
    "map_yaml": Target("map.yaml", read_description, write_text(MAP)),
    "world_toml": Target("world.toml", lambda path: worlds.load(str(path)), write_text(WORLD)),
    "lidar_toml": Target("lidar.toml", load_lidar, lambda path: copy_preset("lidars/rplidar_a2.toml", path)),
    "robot_toml": Target("robot.toml", load_robot, lambda path: copy_preset("robots/create3.toml", path)),
    "sweep_toml": Target("sweep.toml", read_document, write_text(SWEEP)),
    "commands": Target("commands.csv", read_commands, write_text(COMMANDS)),
    "checkpoint": Target("filter.npz", load_checkpoint, write_checkpoint),
}


def copy_preset(name: str, path: Path) -> None:
    """Copy a preset of the package."""
    import testbed.presets

    shutil.copy(Path(testbed.presets.__file__).parent / name, path)


def problem_of(target: Target, path: Path) -> str | None:
    """What is wrong with how a reader takes a file: None where it reads it, or refuses it in one short line."""
    try:
        target.read(path)
    except ValueError as error:
        text = str(error)
        if str(path) in text and "\n" not in text and len(text) <= MAX_MESSAGE:
            return None
        return f"{type(error).__name__} without the file's name, or of several lines: {text[:300]!r}"
    except Exception as error:  # whatever else ends a reader is what is searched for
        return f"{type(error).__name__}: {error!s:.300}"
    return None
