# SPDX-License-Identifier: MIT
"""The messages of an SQLite bag that was cut off, page by page: the pages that lead to them may be in the missing part.

Source: the SQLite file format, https://www.sqlite.org/fileformat2.html, sections 1.5, 1.6 and 2.1.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

TABLE_LEAF = 0x0D
"""First byte of a page with rows of a table."""
_HEAD = 100
"""Bytes of the file's head, at the begin of the first page."""
_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 8: 0, 9: 0}
"""Bytes of the integers of a row, by their type; types 8 and 9 are the numbers 0 and 1."""


class Row(NamedTuple):
    """A message: the columns of rosbag2's table."""

    number: int
    topic: int
    time: int
    """[ns]"""
    data: bytes


def message_rows(file: Path) -> Iterator[Row]:
    """The messages in the pages of a file that are there, in the order of the pages."""
    with file.open("rb") as source:
        head = source.read(_HEAD)
        size = page_size(head)
        usable = size - head[20]
        for begin in range(size, source.seek(0, 2), size):  # the first page lists the tables
            source.seek(begin)
            page = source.read(size)
            if len(page) == size and page[0] == TABLE_LEAF:
                yield from _rows(page, source, size, usable)


def page_size(head: bytes) -> int:
    """Bytes of a page, by the head of a file; 1 stands for 65536."""
    (size,) = struct.unpack_from(">H", head, 16)
    return 65536 if size == 1 else int(size)


def _rows(page: bytes, source: BinaryIO, size: int, usable: int) -> Iterator[Row]:
    (count,) = struct.unpack_from(">H", page, 3)
    if 8 + 2 * count > usable:
        return
    for (at,) in struct.iter_unpack(">H", page[8 : 8 + 2 * count]):
        try:
            row = _row(page, at, source, size, usable)
        except (struct.error, IndexError):  # a page of something else
            continue
        if row is not None:
            yield row


def _row(page: bytes, at: int, source: BinaryIO, size: int, usable: int) -> Row | None:
    """The row at a place of a page; None where it is no message, or its end is missing."""
    length, at = _varint(page, at)
    number, at = _varint(page, at)
    here = _local_bytes(length, usable)
    content = page[at : at + here]
    if here < length:
        (following,) = struct.unpack_from(">I", page, at + here)
        content += _overflow(source, following, length - here, size, usable)
    if len(content) < length:
        return None
    head, begin = _varint(content, 0)
    kinds = []
    while begin < head:
        kind, begin = _varint(content, begin)
        kinds.append(kind)
    if len(kinds) != 4 or kinds[0] != 0 or not {kinds[1], kinds[2]} <= _INTEGER_BYTES.keys():
        return None
    if kinds[3] < 12 or kinds[3] % 2:  # no BLOB
        return None
    topic, begin = _integer(content, begin, kinds[1])
    time, begin = _integer(content, begin, kinds[2])
    data = content[begin : begin + (kinds[3] - 12) // 2]
    return Row(number, topic, time, data)


def _overflow(source: BinaryIO, page: int, length: int, size: int, usable: int) -> bytes:
    """The rest of a row on further pages, as far as they are there."""
    parts = []
    while page and length > 0:
        source.seek((page - 1) * size)
        content = source.read(size)
        if len(content) < size:
            break
        (page,) = struct.unpack_from(">I", content)
        parts.append(content[4 : min(usable, 4 + length)])
        length -= len(parts[-1])
    return b"".join(parts)


def _local_bytes(length: int, usable: int) -> int:
    """How much of a row of some length is on its own page [bytes]."""
    if length <= usable - 35:
        return length
    least = (usable - 12) * 32 // 255 - 23
    most = least + (length - least) % (usable - 4)
    return most if most <= usable - 35 else least


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """An integer of one to nine bytes, and where it ends."""
    value = 0
    for k in range(8):
        byte = data[at + k]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at + k + 1
    return value << 8 | data[at + 8], at + 9


def _integer(data: bytes, at: int, kind: int) -> tuple[int, int]:
    """An integer of a row, and where it ends."""
    end = at + _INTEGER_BYTES[kind]
    return (kind - 8 if kind >= 8 else int.from_bytes(data[at:end], "big", signed=True)), end
