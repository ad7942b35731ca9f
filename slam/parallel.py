# SPDX-License-Identifier: MIT
"""Run compiled loops over particles on several threads, with the same bits for any number of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise
from typing import Any


class Threads:
    """Splits a loop `kernel(start, stop, *arguments)` into ranges; each range writes rows of its own only.

    Kernels release the GIL, so plain threads suffice: no threading layer of numba, nothing that a fork or a second
    user of numba could upset.
    """

    def __init__(self, count: int | None = None) -> None:
        """Use `count` threads, by default one per core that this process may use."""
        self.count = _cores() if count is None else count
        if self.count < 1:
            raise ValueError(f"threads must be at least 1, got {self.count}")
        self._pool = ThreadPoolExecutor(self.count - 1) if self.count > 1 else None

    def run(self, kernel: Callable[..., object], rows: int, *arguments: Any) -> None:
        """Call the kernel for rows [0, rows), split evenly."""
        if self._pool is None or rows < 2:
            kernel(0, rows, *arguments)
            return
        parts = min(self.count, rows)
        borders = [rows * k // parts for k in range(parts + 1)]
        first, *others = pairwise(borders)
        futures = [self._pool.submit(kernel, start, stop, *arguments) for start, stop in others]
        try:
            kernel(*first, *arguments)  # this thread works too
        finally:
            wait(futures)
        for future in futures:
            future.result()


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
