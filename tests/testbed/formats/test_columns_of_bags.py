# SPDX-License-Identifier: MIT
"""What a bag costs while it is read: columns, not an object for each message."""

import tracemalloc
from dataclasses import replace

import numpy as np

from testbed.formats import open_log
from testbed.formats.ros.reading import tracks
from tests.testbed.formats.bags import bag, changed, set_back

MAX_BYTES = 1000
"""Of a scan and two messages of odometry, at most at a time; as objects they took 3,900."""


def longer(messages: list, times: int, span: float = 8.1) -> list:
    """The drive several times, one after the other in time."""
    found = [message for message in messages if message[0] == "/tf_static"]
    for k in range(times):
        shift = round(k * span * 1e9)
        found += [(a, time + shift, set_back(m, -k * span)) for a, time, m in messages if a in ("/scan", "/odom")]
    return found


def test_memory_does_not_grow_by_the_messages(tmp_path, messages, monkeypatch):
    monkeypatch.setattr(tracks, "BATCH", 100)
    messages = changed(messages, "/scan", lambda scan, _: replace(scan, ranges=scan.ranges[:2], angle_max=0.0))
    messages = changed(
        messages, "/scan", lambda scan, _: replace(scan, angle_max=scan.angle_min + scan.angle_increment)
    )
    peaks, counts = [], []
    for times in (4, 20):
        path = bag(tmp_path / f"bag_{times}", longer(messages, times))
        tracemalloc.start()
        counts.append(open_log(path).scan_count)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert counts[1] > 4 * counts[0] > 1000
    assert (peaks[1] - peaks[0]) / (counts[1] - counts[0]) < MAX_BYTES


def test_the_parts_of_long_odometry_are_one(tmp_path, messages, sound, monkeypatch):
    monkeypatch.setattr(tracks, "BATCH", 7)
    table = open_log(bag(tmp_path / "bag", messages)).table
    for name in ("stamps", "odometry", "twist", "ranges"):
        np.testing.assert_array_equal(getattr(table, name), getattr(sound, name))


def test_beam_times_that_all_differ_are_shared(tmp_path, messages, sound):
    """Drivers that measure the time of each turn state another one for each scan."""
    turns = np.random.default_rng(0).uniform(0.0995, 0.1005, 1000)
    beams = sound.readings[0]
    path = bag(
        tmp_path / "bag",
        changed(
            longer(messages, 4),
            "/scan",
            lambda scan, k: replace(scan, time_increment=np.float32(turns[k] / beams).item()),
        ),
    )
    table = open_log(path).table
    assert len(table.patterns) <= 102  # 1 ms in steps of 10 us
    assert len({id(pattern.angles) for pattern in table.patterns}) == 1
    whole = [table.patterns[k].time_offsets[-1] * beams / (beams - 1) for k in table.scan_patterns]
    np.testing.assert_allclose(whole, turns[: len(whole)], atol=6e-6)
