# SPDX-License-Identifier: MIT
"""Recorded commands: read with care, repeated to the bit."""

import dataclasses

import numpy as np
import pytest

from testbed.formats import LogError
from testbed.formats.commands import commands_of, read_commands, write_commands
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, SimulationConfig, simulate
from testbed.simulation.config import CONTROL_PERIOD
from testbed.simulation.drivers.driver import Command
from testbed.simulation.drivers.recorded import RecordedDriver
from tests.testbed.simulation.small_worlds import perfect, room
from worlds import Box, Person

CONFIG = SimulationConfig(backend="fast", duration=20.0)


def frames(world, config, driver=None):
    with simulate(world, config, driver) as simulation:
        return list(simulation)


@pytest.mark.parametrize("layers", [LidarLayers(), LidarLayers.none()])
@pytest.mark.parametrize("backend", ["fast", "pybullet"])
def test_a_drive_comes_out_again_bit_by_bit(layers, backend):
    """Waiting for someone on the way is part of it."""
    if backend == "pybullet":
        pytest.importorskip("pybullet")
    strolling = Person(name="p", points=[(1.5, 1.5), (1.5, 0.0), (2.6, 0.0), (2.6, -1.5)], speed=0.15)
    world = room(tour=[(3, 0), (3, 2)], people=[strolling])
    config = dataclasses.replace(CONFIG, backend=backend, lidar_layers=layers, seeds=RunSeeds.from_seed(7))
    first = frames(world, config)
    again = frames(world.model_copy(update={"tour": None}), config, RecordedDriver(commands_of(first), CONTROL_PERIOD))
    assert any(frame.command == (0.0, 0.0) for frame in first[40:-5])
    assert len(first) == len(again)
    for a, b in zip(first, again, strict=True):
        assert (a.stamp, a.command) == (b.stamp, b.command)
        assert np.array_equal(a.truth, b.truth)
        assert np.array_equal(a.odometry, b.odometry)
        assert a.scan is None or np.array_equal(a.scan.ranges, b.scan.ranges, equal_nan=True)


def test_a_command_holds_until_the_next_one():
    driver = RecordedDriver([Command(100.0, 0.3, 0.0), Command(101.0, 0.1, -0.2)], 0.05)
    with simulate(room().model_copy(update={"tour": None}), perfect(backend="fast"), driver) as simulation:
        told = [(frame.stamp, frame.command) for frame in simulation]
    assert simulation.time == pytest.approx(1.05)
    assert simulation.finished
    assert driver.share == pytest.approx(1.0)
    assert all(command == ((0.3, 0.0) if stamp < 0.999 else (0.1, -0.2)) for stamp, command in told)
    assert told[-1][0] == pytest.approx(1.0)


def test_commands_are_clipped_and_collisions_are_reported():
    driver = RecordedDriver([Command(0.0, 9.0, 0.0), Command(6.0, 9.0, 0.0)], 0.05)
    world = room(tour=[(0, 3)], boxes=[Box(x=2.0, y=0.0, width=0.2, depth=2.0)])
    with simulate(world, perfect(backend="fast"), driver) as simulation:
        commands = {frame.command for frame in simulation}
    assert commands == {(0.46, 0.0)}
    assert simulation.collided


def test_tables_come_back_to_the_last_digit(tmp_path):
    commands = [Command(0.1 * k, 1.0 / (k + 3), -(2.0**-k)) for k in range(9)]
    write_commands(tmp_path / "commands.csv", commands)
    assert read_commands(tmp_path / "commands.csv") == commands


def test_tables_are_read(tmp_path):
    table = tmp_path / "commands.csv"
    table.write_text("\ufeffstamp,speed,turn_rate\n0,0.1,0\n\n0.5, 0.2 ,-1e-1\n")
    assert read_commands(table) == [(0.0, 0.1, 0.0), (0.5, 0.2, -0.1)]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("stamp,speed,turn_rate\n", "no commands"),
        ("stamp,speed\n0,1\n", ":1: expected the columns stamp,speed,turn_rate, got stamp,speed"),
        ("stamp,speed,turn_rate\n0,1\n", ":2: expected 3 values, got 2"),
        ("stamp,speed,turn_rate\n0,1,2\n1,fast,2\n", ":3: expected numbers, got 1,fast,2"),
        ("stamp,speed,turn_rate\n0,1,nan\n", ":2: expected finite numbers"),
        ("stamp,speed,turn_rate\n2,0,0\n1,0,0\n", ":3: stamp 1 after 2"),
        ("time;v;w\n1;2;3\n", "not a log that can be read"),
    ],
)
def test_bad_tables_are_named_with_the_line(tmp_path, content, complaint):
    table = tmp_path / "commands.csv"
    table.write_text(content)
    with pytest.raises(LogError, match=complaint) as error:
        read_commands(table)
    assert str(error.value).startswith(str(table))
