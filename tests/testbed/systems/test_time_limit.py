# SPDX-License-Identifier: MIT
"""A system that hangs is stopped, wherever it hangs, and is a failed one like others."""

from __future__ import annotations

import signal
import threading
from contextlib import suppress

import pytest

from testbed.systems import check
from testbed.systems.check import check_system
from testbed.systems.entrant import ClassSystem
from testbed.systems.errors import SystemFailedError
from testbed.systems.feeding import feed
from testbed.systems.time_limit import TimeLimitError, time_limit
from tests.testbed.systems.room import Wheels, frames


class HangingAtStart(Wheels):
    def start(self, lidars, seed):
        while True:
            pass


class HangingOnTheWay(Wheels):
    """Catches all exceptions on the way, as a loop that never gives up does."""

    def process(self, frame):
        while frame.stamp > 0.5:
            with suppress(Exception):
                while True:
                    pass
        return frame.odometry


class HangingAtTheEnd(Wheels):
    def finish(self):
        while True:
            pass


@pytest.mark.parametrize(
    ("system", "complaint"),
    [
        (HangingAtStart, "^x: start did not return within the time limit of 0.5 s, expected preparation"),
        (HangingOnTheWay, "process did not return within the time limit of 0.5 s, expected a pose or None"),
        (HangingAtTheEnd, r"^x: after scan 39: finish did not return .* expected \(trajectory or None, map or None\)"),
    ],
)
def test_a_system_that_hangs_is_stopped_and_named(system, complaint):
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(SystemFailedError, match=complaint):
        feed(system(), "x", frames(), seed=0, seconds=0.5)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before


def test_the_limit_is_one_of_each_call():
    with time_limit(5.0):
        pass
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    feed(Wheels(), "x", frames(), seed=0, seconds=60.0)


def test_what_stops_a_call_is_caught_by_no_usual_handler():
    assert not issubclass(TimeLimitError, Exception)


def test_in_another_thread_nothing_is_stopped():
    """Where signals do not arrive; setting their handler would raise there."""
    ended = []

    def run():
        with time_limit(1e-3):
            ended.append(True)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert ended == [True]


def test_the_check_ends_with_a_system_that_hangs(monkeypatch):
    monkeypatch.setattr(check, "CALL_SECONDS", 0.5)
    found = list(check_system(ClassSystem(HangingAtStart)))
    assert any(one.level == "error" and "start did not return within" in one.text for one in found)
