# SPDX-License-Identifier: MIT
"""How much memory this process takes while a block runs. Linux says so; other systems give None."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
RESET_PEAK = "5"
"""What sets the peak of the resident memory to its present size (man proc_pid_clear_refs)."""


class PeakMemory:
    """The result of `peak_memory`, known after its block."""

    megabytes: float | None = None
    """By how much the largest resident memory exceeds that at the start of the block [MB]; None = unknown."""


@contextmanager
def peak_memory() -> Iterator[PeakMemory]:
    """Measure how much the resident memory of this process grows at most while the block runs."""
    found = PeakMemory()
    gc.collect()
    with suppress(OSError, AttributeError):  # memory that was freed and is still held would be used again unseen
        ctypes.CDLL(None).malloc_trim(0)
    try:
        RESET.write_text(RESET_PEAK)
        before = _kilobytes("VmRSS")
    except OSError:
        before = None
    try:
        yield found
    finally:
        peak = None if before is None else _kilobytes("VmHWM")
        if before is not None and peak is not None:
            found.megabytes = max(0.0, (peak - before) * 1024 / 1e6)


def _kilobytes(key: str) -> float | None:
    with suppress(OSError, IndexError, ValueError):
        for line in STATUS.read_text().splitlines():
            if line.startswith(f"{key}:"):
                return float(line.split()[1])
    return None
