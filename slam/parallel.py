# SPDX-License-Identifier: MIT
"""Run compiled loops over particles on several threads, with the same bits for any number of them."""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable
from itertools import pairwise
from queue import SimpleQueue
from typing import Any


class Threads:
    """Splits a loop `kernel(start, stop, *arguments)` into ranges; each range writes rows of its own only.

    Kernels release the GIL, so plain threads suffice: no threading layer of numba, nothing that a fork or a second
    user of numba could upset. Each thread waits at a queue of its own: futures cost several times as much, which shows
    with four loops in a step of a few milliseconds.
    """

    def __init__(self, count: int | None = None) -> None:
        """Use `count` threads, by default one per core that this process may use."""
        self.count = _cores() if count is None else count
        if self.count < 1:
            raise ValueError(f"threads must be at least 1, got {self.count}")
        self._inboxes: list[SimpleQueue[Any]] = [SimpleQueue() for _ in range(self.count - 1)]
        for inbox in self._inboxes:
            threading.Thread(target=_work, args=(inbox,), daemon=True).start()
        weakref.finalize(self, _dismiss, self._inboxes)

    def run(self, kernel: Callable[..., object], rows: int, *arguments: Any) -> None:
        """Call the kernel for rows [0, rows), split evenly."""
        parts = min(self.count, rows)
        if parts < 2:
            kernel(0, rows, *arguments)
            return
        first, *others = pairwise([rows * k // parts for k in range(parts + 1)])
        done: SimpleQueue[BaseException | None] = SimpleQueue()
        for inbox, (start, stop) in zip(self._inboxes, others, strict=False):
            inbox.put((done, kernel, start, stop, arguments))
        try:
            kernel(*first, *arguments)  # this thread works too
        finally:
            errors = [done.get() for _ in others]
        for error in errors:
            if error is not None:
                raise error


def _work(inbox: SimpleQueue[Any]) -> None:
    """Do what comes in, until None does; holds on to nothing in between."""
    while (job := inbox.get()) is not None:
        done, kernel, start, stop, arguments = job
        try:
            kernel(start, stop, *arguments)
            done.put(None)
        except BaseException as error:
            done.put(error)
        del job, done, kernel, arguments


def _dismiss(inboxes: list[SimpleQueue[Any]]) -> None:
    for inbox in inboxes:
        inbox.put(None)


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
