# SPDX-License-Identifier: MIT
"""A short drive through office as messages, and as the table that a reader makes of them."""

from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from testbed.datasets.simulated import write_dataset
from testbed.formats import open_log
from testbed.frame_table import FrameTable
from testbed.simulation import SimulationConfig
from tests.testbed.formats.bags import STORE, bag
from worlds import load

TOPICS = ("/scan", "/odom", "/tf", "/tf_static")


@pytest.fixture(scope="session")
def source(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("source") / "drive"
    config = SimulationConfig(backend="fast", duration=8.0)
    write_dataset(path, load("office"), config, {"seed": 0}, log_format="rosbag2-lean")
    return path


@pytest.fixture(scope="session")
def messages(source) -> list:
    with AnyReader([source], default_typestore=STORE) as reader:
        found = [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]
    return [message for message in found if message[0] in TOPICS]


@pytest.fixture(scope="session")
def sound(tmp_path_factory, messages) -> FrameTable:
    return open_log(bag(tmp_path_factory.mktemp("sound") / "bag", messages)).table
