# SPDX-License-Identifier: MIT
"""Readings of recordings of any length: those beyond a limit lie in temporary files without a name, which the system
takes out of memory where it needs the room, and which are gone with the arrays."""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

IN_MEMORY = 30_000_000
"""Readings of so many bytes stay in memory: half an hour of 360 beams at 10 Hz."""
SEGMENT = 16_000_000
"""Bytes of a file's piece, and of what is copied at a time."""

Ranges = NDArray[np.float32] | NDArray[np.float64]
Kind = TypeVar("Kind", np.float32, np.float64)


class ReadingsStore:
    """Keeps the readings of scans, which come one after the other: those of a recording while it is read, and those of
    a run while it runs."""

    def __init__(self, in_memory: int = IN_MEMORY, kind: type = np.float32) -> None:
        """in_memory: bytes that stay in memory; kind: of the readings, float32 or float64"""
        self._left = in_memory
        self._kind = np.dtype(kind)
        self._segments: list[NDArray[Any]] = []
        self._used = 0

    def keep(self, ranges: NDArray[Kind]) -> NDArray[Kind]:
        """The same readings (n,), in memory or in a file; a message that they are a part of can be forgotten."""
        if ranges.nbytes <= self._left:
            self._left -= ranges.nbytes
            return ranges if ranges.base is None else ranges.copy()
        if not self._segments or self._used + ranges.size > self._segments[-1].size:
            self.forget()
            self._segments.append(in_file(max(SEGMENT // self._kind.itemsize, ranges.size), self._kind))
            self._used = 0
        kept: NDArray[Kind] = self._segments[-1][self._used : self._used + ranges.size]
        kept[:] = ranges
        self._used += ranges.size
        return kept

    @property
    def is_full(self) -> bool:
        """Whether some readings are in files."""
        return bool(self._segments)

    def forget(self) -> None:
        """Let go of the memory of what is in files; it is read again when it is needed."""
        for segment in self._segments:
            forget_pages(segment)


def joined(parts: Sequence[Ranges], in_memory: int = IN_MEMORY) -> NDArray[Any]:
    """Readings one after the other, (readings,); in a file where they are many."""
    count, kind = sum(part.size for part in parts), parts[0].dtype if parts else np.dtype(np.float32)
    if kind.itemsize * count <= in_memory:
        return np.concatenate(parts) if parts else np.empty(0, dtype=kind)
    whole, at, since = in_file(count, kind), 0, 0
    for k, part in enumerate(parts):
        whole[at : at + part.size] = part
        at += part.size
        if at - since > SEGMENT // kind.itemsize:
            since = at
            forget_pages(whole)
        if k + 1 == len(parts) or _mapped(part) is not _mapped(parts[k + 1]):
            forget_pages(part)
    forget_pages(whole)
    return whole


def in_file(count: int, kind: np.dtype[Any] = np.dtype(np.float32)) -> NDArray[Any]:  # noqa: B008 - never changed
    """Zeros (count,) in a temporary file. Raises OSError, naming the temporary folder, where there is no room."""
    size = kind.itemsize * count
    with tempfile.TemporaryFile() as file:
        try:
            if hasattr(os, "posix_fallocate"):  # else a write into the array would end the process on a full disk
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                file.truncate(size)
        except OSError as error:
            reason = f"{error.strerror}, for the scans of a long recording or run"
            raise OSError(error.errno, reason, tempfile.gettempdir()) from None
        return np.frombuffer(mmap.mmap(file.fileno(), size), dtype=kind)


def forget_pages(array: NDArray[np.generic]) -> None:
    """Let go of the memory of an array that lies in a file; it is read again when it is needed."""
    mapped = _mapped(array)
    if isinstance(mapped, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def _mapped(array: NDArray[Any]) -> object:
    """The file that an array lies in, or what else holds its memory."""
    base: Any = array
    while isinstance(base, np.ndarray) and base.base is not None:
        base = base.base
    return base.obj if isinstance(base, memoryview) else base
