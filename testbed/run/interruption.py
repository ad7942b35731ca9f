# SPDX-License-Identifier: MIT
"""Ctrl-C and SIGTERM: they raise KeyboardInterrupt, or during a run finish the current frame and end it.

KeyboardInterrupt must not be raised within libraries that lose it: numba's wrappers of compiled functions look up
types in Python and turn any exception there into a SystemError, weak references drop those of their callbacks, and a
module whose import ends half way may be left broken. There the signal waits for a moment. Where Python or a library has
dropped it all the same ("Exception ignored in …") or turned it into another exception it is raised again.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from _thread import start_new_thread
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

SIGNALS = (signal.SIGINT, signal.SIGTERM)
OURS = frozenset(("testbed", "slam", "eval"))
CARELESS = frozenset(("llvmlite", "numba", "numpy", "weakref"))
"""Packages that may lose a KeyboardInterrupt."""
WAIT = 0.01
"""Time until a signal is tried again [s]."""
LONGEST_WAIT = 5.0
"""After so long it is raised all the same: compiling all kernels takes longer [s]."""


class Interruption:
    """A flag that the first signal sets; the second signal raises KeyboardInterrupt, as the caller's handler does."""

    def __init__(self) -> None:
        self.requested = False
        self._callers = {int(number): signal.getsignal(number) for number in SIGNALS}

    def note(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        if not self.requested:
            self.requested = True
        elif callable(caller := self._callers[number]):
            caller(number, frame)
        else:
            raise KeyboardInterrupt


@contextmanager
def signals_interrupt() -> Iterator[None]:
    """Make SIGTERM, which batch systems send, raise KeyboardInterrupt as Ctrl-C does; only in the main thread.

    Where Ctrl-C is ignored, as in the background of a shell, it stays so.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [signal.SIGTERM]
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        numbers.append(signal.SIGINT)
    patience = _Patience()
    previous, hook = {number: signal.signal(number, patience.interrupt) for number in numbers}, sys.unraisablehook
    sys.unraisablehook = patience.hook_before(hook)
    try:
        yield
    except (RuntimeError, SystemError) as error:  # as C code and the making of classes report any exception
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise
    finally:
        patience.is_over = True
        sys.unraisablehook = hook
        for number, handler in previous.items():
            signal.signal(number, handler)


def signals_end_process(status: int) -> None:
    """Let signals end the process at once with `status`: all is written, only Python itself is still to be ended.

    By default they would end it with their own number then, or with a traceback, as if the command had failed.
    """
    if threading.current_thread() is not threading.main_thread():
        return

    def end(number: int, frame: FrameType | None) -> None:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, RuntimeError):  # its reader has gone, it is closed, it is being flushed
                stream.flush()
        os._exit(status)

    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, end)


class _Patience:
    """Raises KeyboardInterrupt on a signal, as soon as no library is at work that would lose it."""

    def __init__(self) -> None:
        self.is_over = False
        """Whether the command has ended: a signal that waits is then forgotten."""
        self._since: float | None = None

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal: raise, or send it again shortly after; `LONGEST_WAIT` after the first one, raise."""
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        if now - self._since < LONGEST_WAIT and _would_be_lost(frame):
            start_new_thread(self._send_again, (number,))  # threading.Timer takes locks, which this thread may hold
            return
        self._since = None
        raise KeyboardInterrupt

    def hook_before(self, hook: Callable[[UnraisableHookArgs], object]) -> Callable[[UnraisableHookArgs], None]:
        """A hook for exceptions that were dropped: an interrupt is raised again, others go to `hook`."""

        def notice(dropped: UnraisableHookArgs) -> None:
            if issubclass(dropped.exc_type, KeyboardInterrupt):
                start_new_thread(self._send_again, (signal.SIGTERM,))
            else:
                hook(dropped)

        return notice

    def _send_again(self, number: int) -> None:
        time.sleep(WAIT)
        main = threading.main_thread().ident
        if main is not None and not self.is_over:
            signal.pthread_kill(main, number)


def _would_be_lost(frame: FrameType | None) -> bool:
    """Whether something is being imported, or the innermost frame of ours called a library that loses the signal."""
    is_ours = False
    while frame is not None:
        package = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        is_ours |= package in OURS
        if package == "importlib" or (package in CARELESS and not is_ours):
            return True
        frame = frame.f_back
    return False


@contextmanager
def deferred_interruption() -> Iterator[Interruption]:
    """Set a flag on signals instead of raising KeyboardInterrupt, so that no frame is left half processed.

    Other threads than the main one allow no signal handlers; nothing changes there.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    previous = {number: signal.signal(number, interruption.note) for number in SIGNALS}
    try:
        yield interruption
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
