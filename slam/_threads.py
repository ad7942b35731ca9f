# SPDX-License-Identifier: MIT
"""Run compiled loops over particles on several threads, with the same bits for any number of them."""

from __future__ import annotations

import os
import threading
import weakref
from collections import deque
from collections.abc import Callable
from functools import lru_cache
from queue import SimpleQueue
from typing import Any


class Threads:
    """Splits a loop `kernel(start, stop, *arguments)` into ranges; each range writes rows of its own only.

    Kernels release the GIL, so plain threads suffice: no threading layer of numba that a second user of numba could
    upset. Each thread waits at a queue of its own: futures cost several times as much, which shows with four loops in
    a step of a few milliseconds. A forked process starts threads of its own.
    """

    def __init__(self, count: int | None = None) -> None:
        """Use `count` threads, by default one per core that this process may use."""
        self.count = core_count() if count is None else count
        if self.count < 1:
            raise ValueError(f"threads must be at least 1, got {self.count}")
        self._process = 0  # in which the threads run
        self._inboxes: list[SimpleQueue[Any]] = []

    def _started(self) -> list[SimpleQueue[Any]]:
        """The queues at which this process's threads wait."""
        if self._process != os.getpid():
            inboxes: list[SimpleQueue[Any]] = [SimpleQueue() for _ in range(self.count - 1)]
            weakref.finalize(self, _stop_workers, inboxes)
            for inbox in inboxes:
                threading.Thread(target=_work, args=(inbox,), daemon=True).start()
            self._inboxes, self._process = inboxes, os.getpid()  # last: where this is interrupted it is done again
        return self._inboxes

    def run(self, kernel: Callable[..., object], rows: int, *arguments: Any) -> None:
        """Call the kernel for rows [0, rows), in ranges of which each thread takes the next when it is done with one.

        Returns, or raises what any of them, Ctrl-C or another signal has raised, only when no thread works on it any
        more.
        """
        parts = min(self.count, rows)
        if parts < 2:
            kernel(0, rows, *arguments)
            return
        ranges = deque(_ranges(rows, parts))
        first = ranges.popleft()
        bell: SimpleQueue[None] = SimpleQueue()
        outcomes: list[BaseException | None] = []  # one of each thread, there before it rings the bell
        raised: BaseException | None = None
        inboxes = self._started()[: parts - 1]
        try:
            for inbox in inboxes:
                inbox.put((bell, outcomes, kernel, ranges, arguments))
            kernel(*first, *arguments)  # this thread works too, before the others are awake
            _take(ranges, kernel, arguments)
            for _ in inboxes:
                bell.get()
        except BaseException as error:
            raised = _after_all_work(inboxes, error)
        for outcome in (raised, *outcomes):
            if outcome is not None:
                raise outcome


def _work(inbox: SimpleQueue[Any]) -> None:
    """Do what comes in, until None does; holds on to nothing in between."""
    while (job := inbox.get()) is not None:
        bell, outcomes, kernel, ranges, arguments = job
        try:
            _take(ranges, kernel, arguments)
            outcomes.append(None)
        except BaseException as error:
            outcomes.append(error)
        bell.put(None)
        del job, bell, outcomes, kernel, ranges, arguments


def _after_all_work(inboxes: list[SimpleQueue[Any]], error: BaseException) -> BaseException:
    """Wait until the threads at these queues have done what is in them, however often a signal interrupts that.

    An interrupted loop does not know in which queues its work is. So each gets one job more, without any rows, which is
    done when those before it are. Returns the last interruption, or this error.
    """
    while True:
        try:
            bell: SimpleQueue[None] = SimpleQueue()
            for inbox in inboxes:
                inbox.put((bell, [], None, deque(), ()))
            for _ in inboxes:
                bell.get()
            return error
        except BaseException as interruption:
            error = interruption


def _take(ranges: deque[tuple[int, int]], kernel: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    """Call the kernel for one range after the other, until none is left."""
    while True:
        try:
            start, stop = ranges.popleft()
        except IndexError:
            return
        kernel(start, stop, *arguments)


@lru_cache
def _ranges(rows: int, parts: int) -> tuple[tuple[int, int], ...]:
    """Rows [0, rows) in ranges, large ones first: each 1 / (2 parts) of what is left, so that threads which wake late
    or have more to do come to their end with the others, and 1 / (4 parts) of all at least, since a call costs."""
    ranges, start, least = [], 0, -(-rows // (4 * parts))
    while start < rows:
        stop = min(start + max((rows - start) // (2 * parts), least), rows)
        ranges.append((start, stop))
        start = stop
    return tuple(ranges)


def _stop_workers(inboxes: list[SimpleQueue[Any]]) -> None:
    for inbox in inboxes:
        inbox.put(None)


def core_count() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
