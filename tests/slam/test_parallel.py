# SPDX-License-Identifier: MIT
"""Loops on several threads: every row once, errors come back, nothing is left behind."""

import gc
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.parallel import Threads


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
    own = set(threading.enumerate()) - before
    assert len(own) == 3
    del owner
    gc.collect()
    for thread in own:
        thread.join(timeout=60.0)
    assert not any(thread.is_alive() for thread in own)


def test_no_thread_is_no_number():
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        Threads(0)
