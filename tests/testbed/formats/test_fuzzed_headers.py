# SPDX-License-Identifier: MIT
"""Bags whose fields hold nonsense: each is refused, or noted, or read as if it were sound; never silently wrong."""

import itertools
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from testbed.datasets.simulated import write_dataset
from testbed.formats import LogError, open_log
from testbed.inspect import inspect_log, notes_of
from testbed.simulation import SimulationConfig
from tests.testbed.formats.bags import STORE, bag
from worlds import load

TIME = STORE.types["builtin_interfaces/msg/Time"]
CASES = int(os.environ.get("TESTBED_FUZZ_CASES", "40"))
NUMBERS = [float("nan"), float("inf"), float("-inf"), 0.0, -1.0, 1e-9, 1e9, -1e9, 1e38]
ANGLES = [*NUMBERS, 0.45, -180.0, 360.0, 0.0175, -0.00785]
SCAN_FIELDS = {
    "angle_min": ANGLES,
    "angle_max": ANGLES,
    "angle_increment": ANGLES,
    "time_increment": [value for value in NUMBERS if value not in (0.0, 1e-9)] + [0.1, 125.0],
    "range_min": [value for value in NUMBERS if value not in (0.0, 1e-9)],
    "range_max": [value for value in NUMBERS if not value > 1.0],
    "ranges": ["one fewer"],
    "stamp": [(0, 0), (10**9, 0), (-5, 0), (2**31 - 1, 999_999_999)],
    "frame_id": ["", "elsewhere"],
}
"""Nonsense; a `range_max` of 1e9 m is none, since it means any range."""
ODOMETRY_FIELDS = {
    "position": [value for value in NUMBERS if not np.isfinite(value)],
    "orientation": [*NUMBERS, "zero"],
    "stamp": SCAN_FIELDS["stamp"],
    "frame_id": ["", "map"],
    "child_frame_id": ["", "elsewhere"],
}
CHANGES = [
    (topic, field, value)
    for topic, fields in (("/scan", SCAN_FIELDS), ("/odom", ODOMETRY_FIELDS))
    for field, values in fields.items()
    for value in values
]
OF_ALL = [("/scan", "ranges", value) for value in ("empty", "millimetres", "nan", "zero", "infinite", "negative")]
"""Changes that are nonsense in all messages; a single scan may be empty."""


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    path = tmp_path_factory.mktemp("source") / "drive"
    write_dataset(
        path, load("office"), SimulationConfig(backend="fast", duration=3.0), {"seed": 0}, log_format="rosbag2-lean"
    )
    with AnyReader([path], default_typestore=STORE) as reader:
        found = [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]
    return [message for message in found if message[0] in ("/scan", "/odom", "/tf_static")]


@pytest.fixture(scope="module")
def sound(tmp_path_factory, messages):
    return open_log(bag(tmp_path_factory.mktemp("sound") / "bag", messages))


def with_field(message, field, value):
    if field == "stamp":
        return replace(message, header=replace(message.header, stamp=TIME(*value)))
    if field == "frame_id":
        return replace(message, header=replace(message.header, frame_id=value))
    if field == "ranges":
        ranges = message.ranges
        changed = {
            "empty": ranges[:0],
            "millimetres": 1000.0 * ranges,
            "nan": np.nan * ranges,
            "zero": 0.0 * np.nan_to_num(ranges, posinf=0.0),
            "infinite": np.inf + 0.0 * np.nan_to_num(ranges, posinf=0.0),
            "negative": -ranges,
            "one fewer": ranges[:-1],
        }
        return replace(message, ranges=np.ascontiguousarray(changed[value], dtype=np.float32))
    if field in ("position", "orientation"):
        part = getattr(message.pose.pose, field)
        part = replace(part, x=0.0, y=0.0, z=0.0, w=0.0) if value == "zero" else replace(part, x=value)
        return replace(message, pose=replace(message.pose, pose=replace(message.pose.pose, **{field: part})))
    return replace(message, **{field: value})


def same(a, b):
    arrays = [("stamps", 1e-9), ("odometry", 1e-6), ("mounts", 1e-6), ("range_limits", 1e-6), ("ranges", 1e-6)]
    if any(getattr(a, name).shape != getattr(b, name).shape for name, _ in arrays):
        return False
    if not all(np.allclose(getattr(a, name), getattr(b, name), atol=atol, equal_nan=True) for name, atol in arrays):
        return False
    return all(
        np.allclose(p.angles, q.angles) and np.allclose(times(p), times(q))
        for p, q in itertools.product(a.patterns, b.patterns)
    )


def times(pattern):
    return np.zeros(pattern.angles.size) if pattern.time_offsets is None else pattern.time_offsets


@given(
    changes=st.lists(st.sampled_from(CHANGES), min_size=1, max_size=2, unique_by=lambda change: change[:2]),
    which=st.sampled_from(["all", "one", "half"]),
)
@settings(max_examples=CASES, deadline=None, suppress_health_check=list(HealthCheck))
def test_nonsense_is_refused_or_noted(tmp_path_factory, messages, sound, changes, which):
    folder = tmp_path_factory.mktemp("bag")
    count = len(messages)
    chosen = {
        "all": range(count),
        "one": [count // 2, count // 2 + 1, count // 2 + 2],
        "half": range(count // 2, count),
    }
    changed = list(messages)
    for topic, field, value in changes:
        for k in chosen[which]:
            name, time, message = changed[k]
            if name == topic:
                changed[k] = (name, time, with_field(message, field, value))
    assert_told(folder / "bag", changed, sound)


@pytest.mark.parametrize("change", OF_ALL)
def test_readings_that_are_none_are_refused_or_noted(tmp_path, messages, sound, change):
    topic, field, value = change
    changed = [(name, time, with_field(m, field, value) if name == topic else m) for name, time, m in messages]
    assert_told(tmp_path / "bag", changed, sound)


def assert_told(path, messages, sound):
    """The bag is refused in one line that names it, or read with a note, or read as if it were sound."""
    try:
        log = open_log(bag(path, messages))
    except LogError as error:
        complaint = str(error)
    else:
        told = set(log.notes) - set(sound.notes) or notes_of(inspect_log(log))
        assert told or same(log.table, sound.table)
        complaint = str(path)
    finally:
        shutil.rmtree(path, ignore_errors=True)
    assert str(path) in complaint
    assert "\n" not in complaint
