# SPDX-License-Identifier: MIT
"""Devices and pipes are refused where a file is read whole, also where a link of an unpacked archive leads to one."""

import os
from pathlib import Path

import pytest

import worlds
from testbed.formats import open_log
from testbed.presets import load_lidar, load_robot
from testbed.sweep.spec.spec import read_document
from worlds.format.map_file import read_map_file

READERS = {
    "world.toml": worlds.load,
    "lidar.toml": load_lidar,
    "robot.toml": load_robot,
    "sweep.toml": read_document,
    "map.yaml": read_map_file,
    "drive.log": open_log,
}


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def link_to_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


@pytest.mark.parametrize("make", [make_pipe, link_to_device])
@pytest.mark.parametrize("name", READERS)
def test_a_device_or_a_pipe_is_refused_by_its_name(tmp_path, name, make):
    make(tmp_path / name)
    with pytest.raises(ValueError, match=f"{name}: is a device or a pipe"):
        READERS[name](str(tmp_path / name) if name == "world.toml" else tmp_path / name)


@pytest.mark.parametrize("make", [make_pipe, link_to_device])
def test_a_map_cannot_name_a_device_as_its_picture(tmp_path, make):
    make(tmp_path / "map.pgm")
    (tmp_path / "map.yaml").write_text("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(ValueError, match=r"map\.pgm does not exist"):
        read_map_file(tmp_path / "map.yaml")
