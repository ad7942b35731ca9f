# SPDX-License-Identifier: MIT
"""Loops on several threads: every row once, errors come back, nothing is left behind."""

import gc
import os
import signal
import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam._threads import Threads, _ranges


@given(st.integers(1, 5), st.integers(0, 12))
@settings(deadline=None)
def test_every_row_is_done_once(count, rows):
    done = np.zeros(rows, np.int64)

    def kernel(start, stop, by):
        done[start:stop] += by

    threads = Threads(count)
    for _ in range(3):
        threads.run(kernel, rows, 2)
    np.testing.assert_array_equal(done, 6)


@given(st.integers(1, 5000), st.integers(1, 64))
def test_ranges_are_all_rows_in_their_order(rows, parts):
    ranges = _ranges(rows, parts)
    assert ranges[0][0] == 0
    assert ranges[-1][1] == rows
    assert all(stop == start for (_, stop), (start, _) in pairwise(ranges))
    assert all(start < stop for start, stop in ranges)
    assert len(ranges) <= 4 * parts + 4


@pytest.mark.parametrize("bad", [0, 1, 2])
def test_an_error_in_any_thread_comes_back_and_the_next_loop_works(bad):
    threads, done = Threads(3), np.zeros(3)

    def kernel(start, stop, fails):
        if fails and start == bad:
            raise ArithmeticError(f"row {start}")
        done[start:stop] += 1

    with pytest.raises(ArithmeticError, match=f"row {bad}"):
        threads.run(kernel, 3, True)
    assert done.sum() == 2  # the others came to their end
    threads.run(kernel, 3, False)
    assert done.sum() == 5


def test_threads_end_with_their_owner():
    before = set(threading.enumerate())
    owner = Threads(4)
    owner.run(lambda start, stop: None, 4)
    own = set(threading.enumerate()) - before
    assert len(own) == 3
    del owner
    gc.collect()
    for thread in own:
        thread.join(timeout=60.0)
    assert not any(thread.is_alive() for thread in own)


def test_an_interrupted_loop_is_over_when_the_interruption_comes_through():
    threads, over = Threads(2), []

    def kernel(start, stop):
        if start == 0:
            signal.raise_signal(signal.SIGINT)  # as Ctrl-C, while the other thread works
        else:
            time.sleep(0.2)
            over.append(stop)

    with pytest.raises(KeyboardInterrupt):
        threads.run(kernel, 2)
    assert over == [2]


def test_ctrl_c_while_waiting_for_the_others_waits_on():
    threads, over, begun = Threads(2), [], threading.Event()

    def kernel(start, stop):
        if start == 0:
            begun.wait()  # or this thread would take the other row too
        else:
            begun.set()
            time.sleep(0.2)
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
            time.sleep(0.2)
            over.append(stop)

    with pytest.raises(KeyboardInterrupt):
        threads.run(kernel, 2)
    assert over == [2]


class StopError(BaseException):
    """As a limit of time is one."""


def stop(number, frame):
    raise StopError


def test_any_signal_while_waiting_for_the_others_waits_on():
    threads, over, begun, ended = Threads(2), [], threading.Event(), threading.Event()

    def kernel(start, stop):
        if start == 0:
            begun.wait()
            return
        begun.set()
        for _ in range(3):
            time.sleep(0.1)
            signal.pthread_kill(threading.main_thread().ident, signal.SIGUSR1)
        time.sleep(0.2)
        over.append(stop)
        ended.set()

    before = signal.signal(signal.SIGUSR1, stop)
    try:
        with pytest.raises(StopError):
            threads.run(kernel, 2)
        assert over == [2]
    finally:
        signal.signal(signal.SIGUSR1, signal.SIG_IGN)
        ended.wait()  # or a signal could come after its handler is gone
        signal.signal(signal.SIGUSR1, before)


@pytest.mark.parametrize("is_put", [False, True], ids=["before", "after"])
def test_an_interruption_while_work_is_handed_out_ends(is_put):
    """Just before or after the second thread's queue has it."""
    threads, done = Threads(3), np.zeros(3)

    def kernel(start, stop):
        done[start:stop] += 1

    threads.run(kernel, 3)
    queue = threads._inboxes[1]

    class InterruptedOnce:
        is_over = False

        def put(self, job):
            if self.is_over or is_put:
                queue.put(job)
            if not self.is_over:
                self.is_over = True
                raise KeyboardInterrupt

    threads._inboxes[1] = InterruptedOnce()
    with pytest.raises(KeyboardInterrupt):
        threads.run(kernel, 3)
    threads.run(kernel, 3)
    assert done.min() >= 2


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_has_threads_of_its_own():
    threads, done = Threads(2), np.zeros(2)

    def kernel(start, stop):
        done[start:stop] += 1

    threads.run(kernel, 2)
    child = os.fork()
    if child == 0:  # pragma: no cover
        signal.alarm(60)
        threads.run(kernel, 2)
        os._exit(int(done.sum() != 4))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_no_thread_is_no_number():
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        Threads(0)
