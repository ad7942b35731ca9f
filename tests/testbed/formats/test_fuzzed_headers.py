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

T = STORE.types
TIME = T["builtin_interfaces/msg/Time"]
CASES, NIGHTLY_CASES = int(os.environ.get("TESTBED_FUZZ_CASES", "60")), 2000
HEIGHTS = (-0.1, 0.1)
"""Slice of the point clouds, which lie in the plane of the robot's frame [m]."""
NUMBERS = [float("nan"), float("inf"), float("-inf"), 0.0, -1.0, 1e-9, 1e9, -1e9, 1e38]
NOT_FINITE = [value for value in NUMBERS if not np.isfinite(value)]
ANGLES = [*NUMBERS, 0.45, -180.0, 360.0, 0.0175, -0.00785]
STAMPS = [(0, 0), (10**9, 0), (-5, 0), (2**31 - 1, 999_999_999)]
SIZES = [0, 1, 7, 2**31 - 1]
SCAN_FIELDS = {
    "angle_min": ANGLES,
    "angle_max": ANGLES,
    "angle_increment": ANGLES,
    "time_increment": [value for value in NUMBERS if value not in (0.0, 1e-9)] + [0.1, 125.0],
    "range_min": [value for value in NUMBERS if value not in (0.0, 1e-9)],
    "range_max": [value for value in NUMBERS if not value > 1.0],
    "ranges": ["one fewer"],
    "stamp": STAMPS,
    "frame_id": ["", "elsewhere"],
}
"""Nonsense; a `range_max` of 1e9 m is none, since it means any range."""
ODOMETRY_FIELDS = {
    "position": NOT_FINITE,
    "orientation": [*NUMBERS, "zero"],
    "twist.linear": [1e9, -1e9, 1e38],
    "twist.angular": [1e9, -1e9, 1e38],
    "stamp": STAMPS,
    "frame_id": ["", "map"],
    "child_frame_id": ["", "elsewhere"],
}
MOUNT_FIELDS = {
    "translation": [*NOT_FINITE, 1e9, -1e9, 1e38],
    "rotation": [*NUMBERS, "zero"],
    "parent": ["", "laser", "elsewhere"],
    "child": ["", "base_link", "elsewhere"],
}
CLOUD_FIELDS = {
    "height": SIZES,
    "width": SIZES,
    "point_step": SIZES,
    "row_step": SIZES[1:],
    "data": ["half", "none"],
    "field.name": ["", "q"],
    "field.offset": [2**31 - 1, 13],
    "field.datatype": [0, 9, 255],
    "stamp": STAMPS,
    "frame_id": ["", "elsewhere"],
}
"""A `row_step` of 0 is what many drivers write."""
KINDS = {
    "usual": {"/scan": SCAN_FIELDS, "/odom": ODOMETRY_FIELDS, "/tf_static": MOUNT_FIELDS},
    "echoes": {"/scan": {name: values for name, values in SCAN_FIELDS.items() if name != "ranges"}},
    "odometry in tf": {
        "/tf": {"translation": NOT_FINITE, "rotation": [*NUMBERS, "zero"], "stamp": STAMPS, "parent": ["", "map"]},
        "/scan": SCAN_FIELDS,
    },
    "clouds": {"/scan_cloud": CLOUD_FIELDS, "/tf_static": MOUNT_FIELDS},
}
"""Kinds of bags, and the nonsense for the fields of their topics."""
OF_ALL = [("/scan", "ranges", value) for value in ("empty", "millimetres", "nan", "zero", "infinite", "negative")]
"""Changes that are nonsense in all messages; a single scan may be empty."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("source") / "drive"
    write_dataset(
        path, load("office"), SimulationConfig(backend="fast", duration=3.0), {"seed": 0}, log_format="rosbag2"
    )
    with AnyReader([path], default_typestore=STORE) as reader:
        return [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]


@pytest.fixture(scope="module")
def messages(recorded):
    """The messages of each kind of bag."""
    taken = {
        "usual": ("/scan", "/odom", "/tf_static"),
        "odometry in tf": ("/scan", "/tf", "/tf_static"),
        "clouds": ("/scan_cloud", "/odom", "/tf_static"),
    }
    found = {kind: [message for message in recorded if message[0] in topics] for kind, topics in taken.items()}
    found["echoes"] = [
        (topic, time, with_echoes(message) if topic == "/scan" else message) for topic, time, message in found["usual"]
    ]
    return found


@pytest.fixture(scope="module")
def sound(tmp_path_factory, messages):
    folder = tmp_path_factory.mktemp("sound")
    return {kind: opened(kind, bag(folder / kind, of_kind)) for kind, of_kind in messages.items()}


def opened(kind, path):
    return open_log(path, heights=HEIGHTS if kind == "clouds" else None)


def with_echoes(scan):
    names = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
    echo = T["sensor_msgs/msg/LaserEcho"]
    return T["sensor_msgs/msg/MultiEchoLaserScan"](
        header=scan.header,
        ranges=[echo(np.array([value], dtype=np.float32)) for value in scan.ranges.tolist()],
        intensities=[],
        **{name: getattr(scan, name) for name in names},
    )


def with_field(message, field, value):
    """A message with nonsense in one field."""
    if hasattr(message, "transforms"):
        return replace(message, transforms=[with_transform_field(part, field, value) for part in message.transforms])
    if field in ("stamp", "frame_id"):
        return replace(message, header=replace(message.header, **{field: TIME(*value) if field == "stamp" else value}))
    outer = {"position": with_pose, "orientation": with_pose, "ranges": with_ranges, "data": with_data}
    prefixed = {"twist": with_twist, "field": with_point_field}
    change = outer.get(field) or prefixed.get(field.partition(".")[0])
    return replace(message, **{field: value}) if change is None else change(message, field, value)


def with_data(cloud, _, value):
    return replace(cloud, data=cloud.data[: len(cloud.data) // 2 if value == "half" else 0])


def with_point_field(cloud, field, value):
    first, *others = cloud.fields
    return replace(cloud, fields=[replace(first, **{field.removeprefix("field."): value}), *others])


def with_twist(message, field, value):
    twist, part = message.twist.twist, field.removeprefix("twist.")
    moved = replace(getattr(twist, part), **{"x" if part == "linear" else "z": value})
    return replace(message, twist=replace(message.twist, twist=replace(twist, **{part: moved})))


def with_pose(message, field, value):
    part = with_numbers(getattr(message.pose.pose, field), value)
    return replace(message, pose=replace(message.pose, pose=replace(message.pose.pose, **{field: part})))


def with_transform_field(transform, field, value):
    if field == "stamp":
        return replace(transform, header=replace(transform.header, stamp=TIME(*value)))
    if field == "parent":
        return replace(transform, header=replace(transform.header, frame_id=value))
    if field == "child":
        return replace(transform, child_frame_id=value)
    part = with_numbers(getattr(transform.transform, field), value)
    return replace(transform, transform=replace(transform.transform, **{field: part}))


def with_numbers(part, value):
    return replace(part, x=0.0, y=0.0, z=0.0, w=0.0) if value == "zero" else replace(part, x=value)


def with_ranges(scan, _, value):
    ranges = scan.ranges
    changed_ranges = {
        "empty": ranges[:0],
        "millimetres": 1000.0 * ranges,
        "nan": np.nan * ranges,
        "zero": 0.0 * np.nan_to_num(ranges, posinf=0.0),
        "infinite": np.inf + 0.0 * np.nan_to_num(ranges, posinf=0.0),
        "negative": -ranges,
        "one fewer": ranges[:-1],
    }
    return replace(scan, ranges=np.ascontiguousarray(changed_ranges[value], dtype=np.float32))


def same(a, b):
    arrays = [("stamps", 1e-9), ("odometry", 1e-6), ("twist", 1e-6), ("mounts", 1e-6)]
    arrays += [("range_limits", 1e-6), ("ranges", 1e-6)]
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


@st.composite
def nonsense(draw):
    """A kind of bag, one or two changes of its fields, and which of the messages have them."""
    kind = draw(st.sampled_from(sorted(KINDS)))
    changes = [
        (topic, field, value)
        for topic, fields in KINDS[kind].items()
        for field, values in fields.items()
        for value in values
    ]
    chosen = st.lists(st.sampled_from(changes), min_size=1, max_size=2, unique_by=lambda change: change[:2])
    return kind, draw(chosen), draw(st.sampled_from(["all", "one", "half"]))


def changed(messages, changes, which):
    """The messages with the fields of all, of some in the middle, or of the second half changed; the static transforms
    are one message."""
    count = len(messages)
    rows = {
        "all": range(count),
        "one": [count // 2, count // 2 + 1, count // 2 + 2],
        "half": range(count // 2, count),
    }[which]
    found = list(messages)
    for topic, field, value in changes:
        for k in range(count) if topic == "/tf_static" else rows:
            name, time, message = found[k]
            if name == topic:
                found[k] = (name, time, with_field(message, field, value))
    return found


def check(folder, messages, sound, case):
    kind, changes, which = case
    assert_told(kind, folder / "bag", changed(messages[kind], changes, which), sound[kind])


SETTINGS = {"deadline": None, "suppress_health_check": list(HealthCheck)}


@given(case=nonsense())
@settings(max_examples=CASES, **SETTINGS)
def test_nonsense_is_refused_or_noted(tmp_path_factory, messages, sound, case):
    check(tmp_path_factory.mktemp("bag"), messages, sound, case)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@given(case=nonsense())
@settings(max_examples=NIGHTLY_CASES, **SETTINGS)
def test_much_nonsense_is_refused_or_noted(tmp_path_factory, messages, sound, case):
    check(tmp_path_factory.mktemp("bag"), messages, sound, case)


@pytest.mark.parametrize("change", OF_ALL)
def test_readings_that_are_none_are_refused_or_noted(tmp_path, messages, sound, change):
    check(tmp_path, messages, sound, ("usual", [change], "all"))


def assert_told(kind, path, messages, sound):
    """The bag is refused in one line that names it, or read with a note, or read as if it were sound."""
    try:
        log = opened(kind, bag(path, messages))
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
