# SPDX-License-Identifier: MIT
"""A limit of the time that a call may take, within this process."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

AGAIN_S = 1.0
"""The call is stopped again and again after this time [s]: it may catch what stops it."""
MIN_REST_S = 1e-6
"""An outer timer whose time is over goes off so soon after the block [s]; 0 would mean never."""


class TimeLimitError(BaseException):
    """The time is over. No `Exception`, so that a call that catches all of these ends too."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Raise TimeLimitError in the block once it has taken so long [s]; None = it may take as long as it wants.

    Compiled code is stopped when it returns to Python. Signals reach the main thread only: other threads are not
    stopped. A limit of the caller, or another timer of his, counts on in the block and after it.
    """
    if seconds is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    is_inside = True

    def stop(number: int, frame: FrameType | None) -> None:
        if not is_inside:  # an alarm that came when the block was left
            return
        if callable(before) and rest and time.monotonic() < began + seconds:  # the caller's time is over, not ours
            before(number, frame)
        else:
            raise TimeLimitError

    began = time.monotonic()
    rest, again = signal.setitimer(signal.ITIMER_REAL, 0.0)  # no alarm comes until its handler is set
    before = signal.signal(signal.SIGALRM, stop)
    try:
        signal.setitimer(signal.ITIMER_REAL, min(seconds, rest or seconds), AGAIN_S)
        yield
    finally:
        is_inside = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        if rest:
            signal.setitimer(signal.ITIMER_REAL, max(rest - (time.monotonic() - began), MIN_REST_S), again)
