# SPDX-License-Identifier: MIT
"""Events that happen again and again are said once in a while."""

from __future__ import annotations

from testbed.views.rerun.layers.repeats import Repeats


def test_what_is_left_out_is_counted_in_the_next_line() -> None:
    repeats = Repeats(20.0)
    found = {time: repeats.say(time) for time in (5.0, 8.0, 12.0, 24.9, 25.0, 44.0, 60.0)}
    assert found == {5.0: "", 8.0: None, 12.0: None, 24.9: None, 25.0: " (3 more since 5 s)", 44.0: None,
                     60.0: " (1 more since 25 s)"}  # fmt: skip


def test_an_event_that_is_twice_as_large_is_said_before() -> None:
    repeats = Repeats(20.0)
    assert repeats.say(0.0, 0.1, 10.0) == ""
    assert repeats.say(1.0, 0.9, 10.0) is None  # one event takes several scans
    assert repeats.say(5.0, 0.15, 19.0) is None
    assert repeats.say(6.0, 0.21, 10.0) == " (2 more since 0 s)"
    assert repeats.say(9.0, 0.1, 21.0) == ""
