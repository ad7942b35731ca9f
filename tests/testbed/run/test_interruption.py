# SPDX-License-Identifier: MIT
"""Signals raise KeyboardInterrupt, but never where a library would lose it."""

import importlib
import os
import signal
import sys
import time
import weakref
from types import FunctionType

import pytest

from testbed.run.interruption import LONGEST_WAIT, deferred_interruption, signals_interrupt

NUMBERS = [signal.SIGINT, signal.SIGTERM]
TURNS = 200
"""Milliseconds that the library is at work after the signal."""


@pytest.fixture(autouse=True)
def ctrl_c_is_heard():
    """In the background of a shell, as these tests may run, programs ignore Ctrl-C."""
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, previous)


def is_interrupted(*actions) -> bool:
    """Whether a signal that the actions cause raises KeyboardInterrupt before all of them and some work are done."""
    try:
        with signals_interrupt():
            for action in actions:
                action()
            work()
    except KeyboardInterrupt:
        return True
    return False


def work() -> None:
    """Python code for some milliseconds, in which a signal is noticed."""
    for _ in range(TURNS):
        time.sleep(0.001)


def of_module(function: FunctionType, name: str) -> FunctionType:
    """The function as if a module of that name had defined it."""
    return FunctionType(function.__code__, {**function.__globals__, "__name__": name}, closure=function.__closure__)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_raises_at_once(number):
    later = []
    assert is_interrupted(lambda: os.kill(os.getpid(), number), work, lambda: later.append(1))
    assert not later


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("library", ["numba.core.serialize", "numpy._core"])
def test_a_signal_waits_for_a_library_that_would_lose_it(number, library):
    steps = []

    def inside() -> None:
        os.kill(os.getpid(), number)
        work()
        steps.append("the library has ended")

    assert is_interrupted(of_module(inside, library))
    assert steps == ["the library has ended"]


class Thing:
    """Something that a weak reference can look at."""


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_within_a_callback_of_a_weak_reference_is_not_lost(number):
    things = [Thing()]

    def forget() -> None:
        os.kill(os.getpid(), number)
        work()

    weakref.finalize(things[0], of_module(forget, "weakref"))
    assert is_interrupted(things.clear)


def test_a_signal_waits_for_the_import_of_a_module_of_ours(tmp_path, monkeypatch):
    """Python turns an exception in the making of a class into a RuntimeError."""
    (tmp_path / "testbed_made.py").write_text(
        "import os, signal, time\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
        "for _ in range(200): time.sleep(0.001)\n"
        "is_whole = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert is_interrupted(lambda: importlib.import_module("testbed_made"))
    assert sys.modules.pop("testbed_made").is_whole


@pytest.mark.parametrize("kind", [RuntimeError, SystemError])
def test_a_signal_that_was_turned_into_another_exception_is_one_again(kind):
    def turn() -> None:
        raise kind("returned a result with an exception set") from KeyboardInterrupt()

    assert is_interrupted(turn)
    with pytest.raises(kind, match="own"), signals_interrupt():
        raise kind("own")


@pytest.mark.parametrize("number", NUMBERS)
def test_a_signal_that_a_library_has_dropped_is_raised_again(number):
    class Careless:
        def __del__(self) -> None:
            os.kill(os.getpid(), number)
            work()

    things = [Careless()]
    assert is_interrupted(things.clear)


@pytest.mark.parametrize("number", NUMBERS)
def test_the_second_signal_of_a_run_waits_for_such_a_library_too(number):
    steps = []

    def inside() -> None:
        for _ in range(2):
            os.kill(os.getpid(), number)
            work()
        steps.append("the library has ended")

    def run() -> None:
        with deferred_interruption() as interruption:
            of_module(inside, "numba.core.serialize")()
            work()
            pytest.fail(f"not interrupted: {interruption.requested}")

    assert is_interrupted(run)
    assert steps == ["the library has ended"]


def test_other_exceptions_that_a_library_drops_are_reported_as_before(monkeypatch):
    class Careless:
        def __del__(self) -> None:
            raise ValueError("dropped")

    reported = []
    monkeypatch.setattr(sys, "unraisablehook", lambda dropped: reported.append(str(dropped.exc_value)))
    things = [Careless()]
    assert not is_interrupted(things.clear)
    assert reported == ["dropped"]


def test_a_library_that_does_not_end_is_interrupted_all_the_same():
    def inside() -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        started = time.monotonic()
        while time.monotonic() < started + 20.0 * LONGEST_WAIT:
            time.sleep(0.001)
        pytest.fail("not interrupted")

    assert is_interrupted(of_module(inside, "numba.core.compiler"))


def test_ctrl_c_stays_ignored_where_it_was():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with signals_interrupt():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


@pytest.mark.parametrize("number", NUMBERS)
def test_the_handlers_of_the_caller_are_restored(number):
    before = signal.getsignal(number)
    with signals_interrupt():
        assert signal.getsignal(number) is not before
    assert signal.getsignal(number) is before
