# SPDX-License-Identifier: MIT
"""Check sums of MCAP files: filled in after writing, verified before reading.

The writer in use leaves them zero, which means "none"; its reader minds those of chunks, which hold the messages, but
not that of the summary, by which it finds topics and chunks.
Source: the MCAP format specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from pathlib import Path

from testbed.formats.log import LogError

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHUNK = 0x02, 0x06
_RECORD = struct.Struct("<BQ")
"""Kind and size, in front of each record."""
_FOOTER_CONTENT = struct.Struct("<QQI")
"""Begin of the summary, begin of its offsets, check sum of the summary and of the footer up to here."""
_END = _RECORD.size + _FOOTER_CONTENT.size + len(MAGIC)
"""Bytes of the footer and the mark behind it."""


def seal(path: Path) -> None:
    """Fill in the check sums of all uncompressed chunks and of the summary, in place."""
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as data:
        at = len(MAGIC)
        while at < len(data) - _END:
            kind, size = _RECORD.unpack_from(data, at)
            if kind == _CHUNK:
                _seal_chunk(data, at + _RECORD.size, size)
            at += _RECORD.size + size
        footer = len(data) - _END + _RECORD.size
        summary_start, _, _ = _FOOTER_CONTENT.unpack_from(data, footer)
        struct.pack_into("<I", data, footer + 16, zlib.crc32(data[summary_start : footer + 16]))


def verify_mcap(path: Path) -> None:
    """Compare the summary of an MCAP file with its check sum, where it has one.

    Raises LogError, naming the file and the place, where they differ or the file has no proper end.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - _END, 0))
        end = file.read()
        if size < _END or not end.endswith(MAGIC) or _RECORD.unpack_from(end) != (_FOOTER, _FOOTER_CONTENT.size):
            raise LogError(f"{path}: damaged MCAP file: ends at byte {size} without its footer: was it cut off?")
        summary_start, _, crc = _FOOTER_CONTENT.unpack_from(end, _RECORD.size)
        if crc == 0:
            return
        checked_end = size - len(MAGIC) - 4
        if summary_start > checked_end:
            raise LogError(f"{path}: damaged MCAP file: the summary begins at byte {summary_start} of {size}")
        file.seek(summary_start)
        if zlib.crc32(file.read(checked_end - summary_start)) != crc:
            raise LogError(f"{path}: damaged MCAP file: bytes {summary_start} to {size} differ from their check sum")


def _seal_chunk(data: mmap.mmap, begin: int, size: int) -> None:
    """Fill in the check sum of a chunk: two times, size, check sum, compression, records."""
    (letters,) = struct.unpack_from("<I", data, begin + 28)
    if letters == 0:  # not compressed
        struct.pack_into("<I", data, begin + 24, zlib.crc32(data[begin + 40 : begin + size]))
