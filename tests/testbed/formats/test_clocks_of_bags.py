# SPDX-License-Identifier: MIT
"""Stamps that are no times of the recording: the bag's own times stand in for them, and a note says so."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.formats import open_log
from tests.testbed.formats.bags import assert_like, at_zero, bag, changed, set_back, stamped

STAMPED = ("/scan", "/odom", "/tf")
SECOND = 10**9


def with_stamps(messages: list, topics: tuple[str, ...], change) -> list:
    """The messages with other stamps in some topics; `change` makes nanoseconds of nanoseconds."""
    return [(topic, t, stamped(m, change) if topic in topics else m) for topic, t, m in messages]


@pytest.mark.parametrize("seconds", [0.3, 1.0, 3.0])
def test_a_clock_that_is_set_back_is_joined(tmp_path, messages, sound, seconds):
    half = messages[len(messages) // 2][1]
    back = [(topic, t, set_back(m, seconds) if t > half else m) for topic, t, m in messages]
    log = open_log(bag(tmp_path / "bag", back))
    assert_like(log.table, sound, atol=1e-6)
    for whose in ("the odometry", "the scans"):
        assert any(f"the clock of {whose} was set back by {seconds:.2f} s" in note for note in log.repairs)


def test_a_clock_that_is_set_back_twice_is_joined(tmp_path, messages, sound):
    third, last = (messages[k * len(messages) // 3][1] for k in (1, 2))
    back = [(topic, t, set_back(m, 0.7 * (t > third) + 0.5 * (t > last))) for topic, t, m in messages]
    log = open_log(bag(tmp_path / "bag", back))
    assert_like(log.table, sound, atol=1e-6)
    assert sum("set back by 0.70 s" in note and "and 1 times more" in note for note in log.repairs) == 2


def test_a_drive_that_begins_again_elsewhere_is_no_clock(tmp_path, messages, sound):
    """The odometry jumps where time steps back: what follows is left out."""
    count = sum(topic == "/odom" for topic, _, _ in messages) // 2
    moved = changed(messages, "/odom", lambda m, k: set_back(_moved(m), 2.0) if k >= count else m)
    log = open_log(bag(tmp_path / "bag", moved))
    assert any("the first pass is used" in note for note in log.repairs)
    assert log.table.stamps.max() <= sound.stamps.max() / 2 + 0.2


def _moved(message):
    pose = message.pose.pose
    away = replace(pose, position=replace(pose.position, x=pose.position.x + 99.0))
    return replace(message, pose=replace(message.pose, pose=away))


def test_messages_in_another_order_are_no_step_of_the_clock(tmp_path, messages, sound):
    swapped = [*messages]
    rows = [k for k, (topic, _, _) in enumerate(messages) if topic == "/odom"]
    for a, b in zip(rows[50:90:4], rows[53:93:4], strict=True):  # three periods of 50 ms
        swapped[a], swapped[b] = (("/odom", messages[at][1], messages[of][2]) for at, of in ((a, b), (b, a)))
    log = open_log(bag(tmp_path / "bag", swapped))
    assert_like(log.table, sound)
    assert not log.repairs


@pytest.mark.parametrize("topic", ["/scan", "/odom"])
def test_messages_that_were_recorded_late_are_no_step_of_the_clock(tmp_path, messages, sound, topic):
    """As by a recorder that is overloaded: some come a third of a second late, behind others."""
    rng = np.random.default_rng(0)
    late = [(name, t + int(rng.uniform(0.0, 0.3e9)) * (name == topic), m) for name, t, m in messages]
    log = open_log(bag(tmp_path / "bag", sorted(late, key=lambda message: message[1])))
    assert_like(log.table, sound)
    assert not log.repairs


@pytest.mark.parametrize("topics", [STAMPED, ("/scan",)])
@pytest.mark.parametrize("unit", [10**3, 10**6])
def test_fractions_of_a_second_in_another_unit(tmp_path, messages, sound, topics, unit):
    small = with_stamps(messages, topics, lambda t: t // SECOND * SECOND + t % SECOND // unit)
    log = open_log(bag(tmp_path / "bag", small))
    assert_like(log.table, sound, atol=1e-6)
    assert any("count no nanoseconds in their fractions of a second: the bag's own" in note for note in log.repairs)


@pytest.mark.parametrize("topics", [STAMPED, ("/scan",)])
@pytest.mark.parametrize(("unit", "name"), [(10**3, "milliseconds"), (10**6, "microseconds")])
def test_stamps_in_another_unit(tmp_path, messages, sound, topics, unit, name):
    log = open_log(bag(tmp_path / "bag", with_stamps(messages, topics, lambda t: t * unit % (2**31 * SECOND))))
    assert_like(log.table, sound, atol=1e-6)
    assert any(f"the stamps of the scans count {name} as seconds" in note for note in log.repairs)


def test_a_replay_at_another_rate_keeps_its_stamps(tmp_path, messages, sound):
    log = open_log(bag(tmp_path / "bag", [(topic, 4 * t, m) for topic, t, m in messages]))
    assert_like(log.table, sound)
    assert not log.repairs


@pytest.mark.parametrize("topic", ["/scan", "/odom"])
def test_stamps_that_are_zero_now_and_then(tmp_path, messages, sound, topic):
    log = open_log(bag(tmp_path / "bag", changed(messages, topic, lambda m, k: at_zero(m) if k % 2 else m)))
    assert_like(log.table, sound, atol=1e-6)
    assert any("are 0: the bag's own times are used for them" in note for note in log.repairs)


def test_transforms_without_stamps(tmp_path, messages, sound):
    kept = [message for message in messages if message[0] != "/odom"]
    log = open_log(bag(tmp_path / "bag", changed(kept, "/tf", at_zero)))
    assert_like(log.table, sound, atol=1e-6)
    assert "all stamps of the odometry are 0 s: the bag's own times are used" in log.repairs


def test_odometry_that_comes_rarely_is_noted(tmp_path, messages):
    rows = iter(range(10**6))
    rare = [
        m for m in messages if m[0] == "/scan" or m[0] == "/tf_static" or (m[0] == "/odom" and next(rows) % 20 == 0)
    ]
    log = open_log(bag(tmp_path / "bag", rare))
    assert "odometry comes every 1.0 s only: poses are interpolated, turns between them are lost" in log.repairs
    assert np.isfinite(log.table.odometry).all()
