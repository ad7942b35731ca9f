# SPDX-License-Identifier: MIT
"""Ctrl-C and SIGTERM during a run, which finish the current frame, then end the run and keep the result so far."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """A flag that the first signal sets; the second signal raises KeyboardInterrupt."""

    def __init__(self) -> None:
        self.requested = False

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Make SIGTERM, which batch systems send, raise KeyboardInterrupt as Ctrl-C does; only in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextmanager
def deferred_interruption() -> Iterator[Interruption]:
    """Set a flag on signals instead of raising KeyboardInterrupt, so that no frame is left half processed.

    Other threads than the main one allow no signal handlers; nothing changes there.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    previous = {number: signal.signal(number, interruption._note) for number in SIGNALS}
    try:
        yield interruption
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
