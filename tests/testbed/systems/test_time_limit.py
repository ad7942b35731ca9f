# SPDX-License-Identifier: MIT
"""A system that hangs is stopped, wherever it hangs, and is a failed one like others."""

from __future__ import annotations

import signal
import threading
import time
from contextlib import suppress

import pytest

from testbed.systems import check
from testbed.systems.check import check_system
from testbed.systems.entrant import ClassSystem
from testbed.systems.errors import SystemFailedError
from testbed.systems.feeding import feed
from testbed.systems.time_limit import TimeLimitError, time_limit
from tests.testbed.systems.room import Wheels, frames


def alarm():
    """The handler of an alarm, whether a timer is set, as one of pytest's is, and the period at which it goes on."""
    rest, again = signal.getitimer(signal.ITIMER_REAL)
    return signal.getsignal(signal.SIGALRM), rest > 0.0, again


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
    before = alarm()
    with pytest.raises(SystemFailedError, match=complaint):
        feed(system(), "x", frames(), seed=0, seconds=0.5)
    assert alarm() == before


def test_the_limit_is_one_of_each_call():
    before = alarm()
    with time_limit(5.0):
        pass
    assert alarm() == before
    feed(Wheels(), "x", frames(), seed=0, seconds=60.0)


def wait_for_an_alarm():
    for _ in range(1000):
        time.sleep(0.01)


def leave_a_limit_and_wait():
    with time_limit(60.0):
        pass
    wait_for_an_alarm()


def test_a_limit_counts_on_after_a_limit_within_it():
    before = alarm()
    with pytest.raises(TimeLimitError), time_limit(0.2):
        leave_a_limit_and_wait()
    assert alarm() == before


def test_a_limit_ends_a_longer_one_within_it():
    before = alarm()
    with pytest.raises(TimeLimitError), time_limit(0.2), time_limit(60.0):
        wait_for_an_alarm()
    assert alarm() == before


def test_a_timer_of_the_caller_goes_off_by_the_handler_of_the_caller():
    class OthersError(Exception):
        pass

    def handler(number, frame):
        raise OthersError

    before, timer = signal.signal(signal.SIGALRM, handler), signal.getitimer(signal.ITIMER_REAL)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(OthersError), time_limit(60.0):
            wait_for_an_alarm()
        assert signal.getsignal(signal.SIGALRM) is handler
    finally:
        signal.setitimer(signal.ITIMER_REAL, *timer)
        signal.signal(signal.SIGALRM, before)


def test_an_alarm_while_the_block_is_left_leaves_nothing_behind(monkeypatch):
    set_timer, before = signal.setitimer, alarm()

    def with_an_alarm(which, seconds, interval=0.0):
        if seconds == 0.0:
            signal.raise_signal(signal.SIGALRM)
        return set_timer(which, seconds, interval)

    with time_limit(60.0):
        monkeypatch.setattr(signal, "setitimer", with_an_alarm)
    assert alarm() == before


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
