# SPDX-License-Identifier: MIT
"""Readings of recordings of any length: those beyond a limit lie in temporary files without a name, which the system
takes out of memory where it needs the room, and which are gone with the arrays."""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Sequence
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

IN_MEMORY = 30_000_000
"""Readings of so many bytes stay in memory: half an hour of 360 beams at 10 Hz."""
SEGMENT = 16_000_000
"""Bytes of a file's piece, and of what is copied at a time."""
PIECE = 1_000_000
"""Bytes that are written to a file at a time."""

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


class ReadingsColumn:
    """Readings that come piece by piece and are one array at last; those beyond a limit go to a temporary file."""

    def __init__(self, in_memory: int = IN_MEMORY) -> None:
        """in_memory: bytes that stay in memory"""
        self._in_memory = in_memory
        self._pieces = bytearray()
        self._file: IO[bytes] | None = None
        self._array: NDArray[np.float32] | None = None
        self._size = 0

    def append(self, ranges: NDArray[np.float32]) -> int:
        """Take in readings (n,); the place of the first one in the array.

        Raises OSError, naming the temporary folder, where there is no room for them.
        """
        begin, self._size = self._size, self._size + ranges.size
        self._pieces += ranges.tobytes()
        if len(self._pieces) > (self._in_memory if self._file is None else PIECE):
            self._write()
        return begin

    def array(self) -> NDArray[np.float32]:
        """All readings (n,); more cannot be taken in."""
        if self._array is None:
            self._array = np.frombuffer(self._pieces, dtype=np.float32) if self._file is None else self._mapped_file()
        return self._array

    def _mapped_file(self) -> NDArray[np.float32]:
        self._write()
        assert self._file is not None
        with self._file as file:
            return np.frombuffer(mmap.mmap(file.fileno(), 4 * self._size), dtype=np.float32)

    def _write(self) -> None:
        try:
            self._file = self._file or tempfile.TemporaryFile()  # noqa: SIM115 - it lives as long as the column
            self._file.write(self._pieces)
            self._file.flush()
        except OSError as error:
            raise _no_room(error) from None
        self._pieces = bytearray()


def gathered(
    whole: NDArray[np.float32], starts: NDArray[np.int64], sizes: NDArray[np.int64], in_memory: int = IN_MEMORY
) -> NDArray[np.float32]:
    """Pieces of an array one after the other, (sum of sizes,); in a file where they are many.

    starts, sizes: first reading of each piece, and their number, (pieces,)
    """
    count = int(sizes.sum())
    out = np.empty(count, dtype=np.float32) if 4 * count <= in_memory else in_file(count)
    at = since = 0
    for k in range(len(starts)):
        begin, size = int(starts[k]), int(sizes[k])
        out[at : at + size] = whole[begin : begin + size]
        at += size
        if 4 * (at - since) > SEGMENT:
            since = at
            forget_pages(out)
            forget_pages(whole)
    return out


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
            raise _no_room(error) from None
        return np.frombuffer(mmap.mmap(file.fileno(), size), dtype=kind)


def _no_room(error: OSError) -> OSError:
    """The same error with the name of the temporary folder."""
    return OSError(error.errno, f"{error.strerror}, for the scans of a long recording or run", tempfile.gettempdir())


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
