# SPDX-License-Identifier: MIT
"""A store gives back the frames that it was given, whether their readings are in memory or in its file."""

import errno
import gc
import os
import tempfile
import weakref
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam import FilterConfig, Scan
from slam.refinement import scan_frames
from testbed import large_arrays
from testbed.estimation.estimation import Estimation
from testbed.frame import Frame
from testbed.run import frame_store
from testbed.run.frame_store import FrameStore
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from tests.testbed.test_large_arrays import is_in_file
from worlds import load

BLOCK = 4


def frame_of(number, beams):
    """A frame with readings of every kind; no scan where beams is None."""
    scan = None
    if beams is not None:
        ranges = np.random.default_rng(number).uniform(0.1, 9.0, beams)
        ranges[::3], ranges[1::5] = np.inf, np.nan
        scan = Scan(
            ranges=ranges,
            angles=np.linspace(-1.0, 1.0, beams),
            range_max=8.0,
            stamp=0.1 * number,
            mount=(0.1, 0.2, 0.3),
            time_offsets=None if number % 2 else np.linspace(0.0, 0.1, beams),
        )
    return Frame(
        stamp=0.1 * number,
        odometry=np.array([number, 0.0, 0.1]),
        scan=scan,
        lidar=Frame.lidar if scan is None else f"lidar {number % 2}",
        twist=None if number % 3 else np.array([0.5, 0.0, number]),
        command=None if number % 5 else (0.25, 0.1 * number),
        truth=None if number % 2 else np.array([0.0, 0.5, number]),
    )


def same(one, other):
    """Whether two frames are equal to the bit."""
    if (one.scan is None) != (other.scan is None):
        return False
    pairs = [(getattr(one, f.name), getattr(other, f.name)) for f in fields(Frame) if f.name != "scan"]
    if one.scan is not None:
        pairs += [(getattr(one.scan, f.name), getattr(other.scan, f.name)) for f in fields(Scan)]
    return all(
        (a is None) == (b is None) and (a is None or np.array_equal(a, b, equal_nan=not isinstance(a, str)))
        for a, b in pairs
    )


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """Blocks of four frames, so that short lists have several."""
    monkeypatch.setattr(frame_store, "BLOCK_FRAMES", BLOCK)


@given(
    st.lists(st.one_of(st.none(), st.integers(0, 40), st.just("drop")), max_size=30),
    st.sampled_from([0, 200, 1000, 10**6]),
)
def test_frames_come_back_to_the_bit(sizes, in_memory):
    store, kept = FrameStore(in_memory), []
    for number, size in enumerate(sizes):
        if size != "drop":
            kept.append(frame_of(number, size))
            store.append(kept[-1])
        elif kept and sizes[number - 1] != "drop":  # right after it was taken in
            kept.pop()
            store.drop_last()
    assert len(store) == len(kept)
    assert all(map(same, store, kept))
    assert all(same(store[k], kept[k]) for k in range(-len(kept), len(kept)))
    assert all(map(same, store[1::2], kept[1::2]))
    assert [scan is None for scan in store.scans] == [frame.scan is None for frame in kept]
    assert store.with_scan.tolist() == [k for k, frame in enumerate(kept) if frame.scan is not None]
    assert np.array_equal(store.stamps, [frame.stamp for frame in kept])
    assert np.array_equal(store.odometry, np.array([frame.odometry for frame in kept]).reshape(-1, 3))


def test_readings_beyond_the_limit_are_not_in_memory():
    store = FrameStore(in_memory=8 * 10 * BLOCK)
    for number in range(3 * BLOCK + 1):
        store.append(frame_of(number, 10))
    assert [is_in_file(block.ranges) for block in store._blocks] == [False, True, True]


def test_no_object_is_kept_for_a_frame_of_a_block():
    store, frames = FrameStore(), [frame_of(number, 10) for number in range(2 * BLOCK + 1)]
    for frame in frames:
        store.append(frame)
    kept = [weakref.ref(store[0]), weakref.ref(store[0].scan)]
    gc.collect()
    assert [reference() for reference in kept] == [None, None]
    assert store[-1] is store[-1]


def test_readings_that_are_a_part_of_something_large_do_not_hold_it():
    whole, store = np.ones(1000), FrameStore()
    scan = replace(frame_of(1, 10).scan, ranges=whole[:10])
    store.append(replace(frame_of(1, 10), scan=scan))
    assert not np.shares_memory(store[0].scan.ranges, whole)


def test_reading_frames_again_lets_go_of_their_memory(monkeypatch):
    monkeypatch.setattr(frame_store, "SEGMENT", 8 * 25)
    forgotten = []
    monkeypatch.setattr(large_arrays, "forget_pages", lambda array: forgotten.append(array.size))
    store = FrameStore(in_memory=0)
    for number in range(5 * BLOCK):
        store.append(frame_of(number, 10))
    forgotten.clear()
    assert all(same(frame, frame_of(number, 10)) for number, frame in enumerate(store))
    assert len(forgotten) == 4  # after each block of four scans of 80 bytes
    forgotten.clear()
    assert all(same(store[number], frame_of(number, 10)) for number in range(8))
    assert len(forgotten) == 2  # after each three scans


def test_a_full_disk_names_the_folder(monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    store = FrameStore(in_memory=0)
    for number in range(BLOCK):
        store.append(frame_of(number, 10))
    with pytest.raises(OSError, match="No space left on device, for the scans of a long recording or run") as error:
        store.append(frame_of(BLOCK, 10))
    assert error.value.filename == tempfile.gettempdir()
    assert len(store) == BLOCK
    assert same(store[BLOCK - 1], frame_of(BLOCK - 1, 10))


def test_a_run_is_the_same_where_nothing_is_kept_in_memory(monkeypatch):
    """Filter, loops, final pass and map, to the bit."""
    config = SimulationConfig(backend="fast", duration=15.0, seeds=RunSeeds.from_seed(3))
    with simulate(load("apartment"), config) as simulation:
        frames = list(simulation)

    def result(in_memory):
        made = Estimation(FilterConfig(particles=2), 0, threads=1)
        made.frames = FrameStore(in_memory)
        for frame in frames:
            made.process(frame)
        refined = made.refined(made.filtered())
        return refined.dense.poses, refined.map.probability

    in_memory = result(10**9)
    monkeypatch.setattr(scan_frames, "KEPT_BEAMS", 0)
    on_disk = result(0)
    assert np.array_equal(in_memory[0], on_disk[0])
    assert np.array_equal(in_memory[1], on_disk[1], equal_nan=True)
