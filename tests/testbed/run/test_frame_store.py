# SPDX-License-Identifier: MIT
"""A store gives back the frames that it was given, whether their readings are in memory or in its file."""

import errno
import os
import tempfile
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam import FilterConfig, Scan
from slam.refinement import scan_frames
from testbed import large_arrays
from testbed.frame import Frame
from testbed.run import frame_store
from testbed.run.estimation import Estimation
from testbed.run.frame_store import FrameStore
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from tests.testbed.test_large_arrays import is_in_file
from worlds import load


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
        )
    return Frame(stamp=0.1 * number, odometry=np.array([number, 0.0, 0.1]), scan=scan, lidar=f"lidar {number % 2}")


def same(one, other):
    """Whether two frames are equal to the bit."""
    if (one.scan is None) != (other.scan is None):
        return False
    scans = one.scan is None or all(
        np.array_equal(getattr(one.scan, f.name), getattr(other.scan, f.name), equal_nan=f.name == "ranges")
        for f in fields(Scan)
        if f.name != "time_offsets"
    )
    return (
        scans and (one.stamp, one.lidar) == (other.stamp, other.lidar) and np.array_equal(one.odometry, other.odometry)
    )


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
        elif kept:
            kept.pop()
            store.drop_last()
    assert len(store) == len(kept)
    assert all(map(same, store, kept))
    assert all(same(store[k], kept[k]) for k in range(-len(kept), len(kept)))
    assert all(map(same, store[1::2], kept[1::2]))
    assert [scan is None for scan in store.scans] == [frame.scan is None for frame in kept]
    assert store.with_scan.tolist() == [k for k, frame in enumerate(kept) if frame.scan is not None]
    assert np.array_equal(store.stamps, [frame.stamp for frame in kept])
    assert np.array_equal(store.odometry, np.array([frame.odometry for frame in kept]))


def test_readings_beyond_the_limit_are_not_in_memory():
    store = FrameStore(in_memory=8 * 10)
    for number in range(5):
        store.append(frame_of(number, 10))
    assert [is_in_file(frame.scan.ranges) for frame in store] == [False, True, True, True, True]


def test_reading_frames_again_lets_go_of_their_memory(monkeypatch):
    monkeypatch.setattr(frame_store, "SEGMENT", 8 * 25)
    forgotten = []
    monkeypatch.setattr(large_arrays, "forget_pages", lambda array: forgotten.append(array.size))
    store = FrameStore(in_memory=0)
    for number in range(9):
        store.append(frame_of(number, 10))
    assert not forgotten
    assert all(same(frame, frame_of(number, 10)) for number, frame in enumerate(store))
    assert len(forgotten) == 2  # after each three scans of 80 bytes


def test_a_full_disk_names_the_folder(monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    store = FrameStore(in_memory=0)
    with pytest.raises(OSError, match="No space left on device, for the scans of a long recording or run") as error:
        store.append(frame_of(0, 10))
    assert error.value.filename == tempfile.gettempdir()
    assert len(store) == 0


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
