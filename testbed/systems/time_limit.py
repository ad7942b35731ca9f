# SPDX-License-Identifier: MIT
"""A limit of the time that a call may take, within this process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

AGAIN_S = 1.0
"""The call is stopped again and again after this time [s]: it may catch what stops it."""


class TimeLimitError(BaseException):
    """The time is over. No `Exception`, so that a call that catches all of these ends too."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Raise TimeLimitError in the block once it has taken so long [s]; None = it may take as long as it wants.

    Compiled code is stopped when it returns to Python. Signals reach the main thread only: other threads are not
    stopped.
    """
    if seconds is None or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise TimeLimitError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
