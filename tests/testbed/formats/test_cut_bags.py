# SPDX-License-Identifier: MIT
"""Bags that end too early, or are packed without a metadata.yaml that says so: what is whole is read."""

import shutil
import struct
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from testbed.formats import open_log
from testbed.formats.ros.mcap import CHUNK, DATA_END, MAGIC, RECORD
from testbed.formats.ros.packing import zstd
from tests.testbed.formats.bags import assert_like, bag

KINDS = [
    (StoragePlugin.SQLITE3, None),
    (StoragePlugin.SQLITE3, "FILE"),
    (StoragePlugin.SQLITE3, "MESSAGE"),
    (StoragePlugin.MCAP, None),
    (StoragePlugin.MCAP, "FILE"),
    (StoragePlugin.MCAP, "MESSAGE"),
    (StoragePlugin.MCAP, "STORAGE"),
]


def the_file(path: Path) -> Path:
    """The file with the messages."""
    return next(file for file in path.iterdir() if file.name != "metadata.yaml")


def assert_begin_of(read, sound, least: float) -> None:
    """The first scans of a recording, at least such a share."""
    count = len(read.scan_rows)
    assert least * len(sound.scan_rows) <= count <= len(sound.scan_rows)
    np.testing.assert_array_equal(read.ranges, sound.ranges[: sound.scan_starts[count]])
    np.testing.assert_allclose(read.odometry[read.scan_rows], sound.odometry[sound.scan_rows[:count]], atol=1e-9)


@pytest.mark.parametrize(("plugin", "packed"), KINDS)
def test_packed_bags_without_metadata_are_read(tmp_path, messages, sound, plugin, packed):
    path = bag(tmp_path / "bag", messages, plugin, packed)
    assert_like(open_log(path).table, sound)
    (path / "metadata.yaml").unlink()
    log = open_log(path)
    assert_like(log.table, sound)
    assert log.repairs == (f"no metadata.yaml: read {the_file(path).name}",)
    assert_like(open_log(the_file(path)).table, sound)


@pytest.mark.parametrize(("plugin", "packed"), KINDS)
def test_bags_with_metadata_of_a_later_ros_are_read(tmp_path, messages, sound, plugin, packed):
    path = bag(tmp_path / "bag", messages, plugin, packed)
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("version: 9", "version: 10"))
    log = open_log(path)
    assert_like(log.table, sound)
    assert log.repairs == (f"metadata.yaml is of version 10, newer than 9: read {the_file(path).name}",)


@pytest.mark.parametrize(("plugin", "packed"), KINDS)
def test_the_begin_of_a_cut_bag_is_read(tmp_path, messages, sound, plugin, packed):
    path = bag(tmp_path / "bag", messages, plugin, packed)
    file = the_file(path)
    file.write_bytes(file.read_bytes()[: int(0.8 * file.stat().st_size)])
    log = open_log(path)
    assert_begin_of(log.table, sound, 0.4)
    assert any("what is whole is read, the rest is left out" in note for note in log.repairs)


def test_zeros_at_the_end_of_an_mcap_file_are_left_out(tmp_path, messages, sound):
    path = bag(tmp_path / "bag", messages, StoragePlugin.MCAP)
    file = the_file(path)
    content, kept = file.read_bytes(), int(0.7 * file.stat().st_size)
    file.write_bytes(content[:kept] + bytes(len(content) - kept))
    log = open_log(path)
    assert_begin_of(log.table, sound, 0.4)
    assert any("the recorder was not stopped properly" in note for note in log.repairs)


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_an_empty_part_of_a_split_bag_is_left_out(tmp_path, messages, sound, plugin):
    path = bag(tmp_path / "bag", messages, plugin)
    file = the_file(path)
    file.with_stem("bag_1").write_bytes(b"")
    (path / "metadata.yaml").unlink()
    log = open_log(path)
    assert_like(log.table, sound)
    assert f"{file.with_stem('bag_1').name}: empty, left out" in log.repairs


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_the_parts_of_a_split_bag_are_one(tmp_path, messages, sound, plugin):
    whole, half = tmp_path / "whole", len(messages) // 2
    whole.mkdir()
    for number, part in enumerate((messages[:half], messages[half:])):
        file = the_file(bag(tmp_path / f"part_{number}", part, plugin))
        shutil.move(file, whole / file.name)
    assert_like(open_log(whole).table, sound)


@pytest.mark.parametrize("packing", ["lz4", "zstd"])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_the_begin_of_a_packed_chunk_is_read(tmp_path, messages, sound, packing, share):
    file = tmp_path / "killed.mcap"
    content = with_packed_chunks(the_file(bag(tmp_path / "bag", messages, StoragePlugin.MCAP)).read_bytes(), packing)
    file.write_bytes(content[: int(share * len(content))])
    assert_begin_of(open_log(file).table, sound, share - 0.3)


def with_packed_chunks(whole: bytes, packing: str) -> bytes:
    """The records of an MCAP file up to its summary, with the chunks packed."""
    pack = zstd().compress if packing == "zstd" else lz4.frame.compress
    at, found = len(MAGIC), [MAGIC]
    while (kind := RECORD.unpack_from(whole, at)[0]) != DATA_END:
        begin, at = at, at + RECORD.size + RECORD.unpack_from(whole, at)[1]
        if kind != CHUNK:
            found.append(whole[begin:at])
            continue
        head, data = whole[begin + RECORD.size : begin + RECORD.size + 28], pack(whole[begin + RECORD.size + 40 : at])
        name = packing.encode()
        chunk = head + struct.pack("<I", len(name)) + name + struct.pack("<Q", len(data)) + data
        found.append(RECORD.pack(CHUNK, len(chunk)) + chunk)
    return b"".join(found)
