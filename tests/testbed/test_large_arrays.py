# SPDX-License-Identifier: MIT
"""Readings beyond a limit lie in files, and are the same to the bit."""

import errno
import mmap
import os
from pathlib import Path

import numpy as np
import pytest

from testbed import large_arrays
from testbed.formats import open_log, parquet
from testbed.formats.write import write_log
from testbed.frame_table import FrameTable, TableFrames
from testbed.large_arrays import ReadingsColumn, ReadingsStore, forget_pages, gathered, in_file, joined
from tests.testbed.equal_frames import assert_equal_frames
from tests.testbed.inspect.test_recording import drive


def is_in_file(array):
    while isinstance(array, np.ndarray):
        array = array.base
    return isinstance(array, memoryview) and isinstance(array.obj, mmap.mmap)


def scans(count):
    rng = np.random.default_rng(count)
    return [rng.random(rng.integers(0, 400)).astype(np.float32) for _ in range(count)]


@pytest.mark.parametrize("segment", [400, 4000, 10**6])
def test_readings_come_back_to_the_bit(segment, monkeypatch):
    monkeypatch.setattr(large_arrays, "SEGMENT", segment)
    parts, store = scans(100), ReadingsStore(in_memory=8000)
    kept = [store.keep(part) for part in parts]
    assert sum(not is_in_file(part) for part in kept if part.size) * 400 < 3 * 8000
    for part, written in zip(kept, parts, strict=True):
        np.testing.assert_array_equal(part, written)
    for limit in (0, 10**9):
        whole = joined(kept, in_memory=limit)
        assert is_in_file(whole) == (limit == 0)
        forget_pages(whole)
        np.testing.assert_array_equal(whole, np.concatenate(parts))
    assert joined([], in_memory=0).size == 0


def test_pages_that_were_forgotten_are_not_resident():
    array = in_file(10_000_000)
    array[:] = 1.0
    before = resident_mb()
    forget_pages(array[5:].reshape(-1))
    assert before - resident_mb() > 35.0
    assert array.sum() == 10_000_000


def resident_mb():
    pages = Path("/proc/self/statm")
    if not pages.exists():
        pytest.skip("the resident set is read from /proc")
    return int(pages.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def test_a_full_disk_is_named(monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space left on device, for the scans of a long recording or run: '/"):
        in_file(10)


def test_a_long_bag_is_the_same_recording(tmp_path, monkeypatch):
    write_log(tmp_path / "bag", drive(seconds=5.0), "rosbag2")
    short = open_log(tmp_path / "bag").table
    monkeypatch.setattr(ReadingsColumn.__init__, "__defaults__", (1000,))
    monkeypatch.setattr(gathered, "__defaults__", (1000,))
    long = open_log(tmp_path / "bag").table
    assert is_in_file(long.ranges)
    assert not is_in_file(short.ranges)
    assert_equal_frames(long.frames(), short.frames())


def test_frames_of_a_table_are_made_when_they_are_asked_for():
    log = drive(seconds=20.0)
    frames, table = log.table.frames(), FrameTable.from_frames(log.table.frames())
    lazy = TableFrames(table)
    assert len(lazy) == len(frames) > 256
    assert_equal_frames(list(lazy), frames)
    assert_equal_frames([lazy[3], lazy[-1], *lazy[255:260]], [frames[3], frames[-1], *frames[255:260]])


@pytest.mark.parametrize("log_format", ["carmen", "parquet"])
def test_a_long_log_is_the_same_recording(tmp_path, monkeypatch, log_format):
    path = tmp_path / ("drive.log" if log_format == "carmen" else "drive")
    write_log(path, drive(seconds=5.0), log_format)
    short = open_log(path).table
    monkeypatch.setattr(ReadingsStore.__init__, "__defaults__", (1000, np.float32))
    monkeypatch.setattr(joined, "__defaults__", (1000,))
    monkeypatch.setattr(parquet, "BLOCK_ROWS", 17)
    long = open_log(path).table
    assert is_in_file(long.ranges)
    assert not is_in_file(short.ranges)
    assert_equal_frames(long.frames(), short.frames())
    assert long.lidars == short.lidars
    assert len(long.patterns) == len(short.patterns)
