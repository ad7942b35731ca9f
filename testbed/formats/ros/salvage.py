# SPDX-License-Identifier: MIT
"""Bags that no recorder has finished, or that were cut: made readable as far as they are whole, in a temporary copy.

A recorder that was killed leaves an MCAP file without its footer, an SQLite file with a journal, or a ROS 1 bag without
an index, and no metadata.yaml. A power cut leaves zeros at the end; files that are packed as a whole end anywhere.
"""

from __future__ import annotations

import bz2
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from testbed.formats.log import LogError
from testbed.formats.ros.mcap import CHUNK, DATA_END, FOOTER, FOOTER_CONTENT, MAGIC, RECORD, verify_mcap
from testbed.formats.ros.packing import zstd
from testbed.formats.ros.sqlite_pages import message_rows, page_size

PACKED = ".zstd"
"""Ending of the files of a bag that are packed as a whole."""
JOURNALS = ("-journal", "-wal")
"""Endings of the files that SQLite leaves next to a data base that was not closed."""
MAX_METADATA_VERSION = 9
"""Newest metadata.yaml that the library reads, that of ROS 2 Jazzy; what is new in others is not needed."""
_SQLITE_HEAD = 100
"""Bytes of the head of an SQLite file."""
ROS1_MAGIC = b"#ROSBAG V2.0\n"
_LENGTH = struct.Struct("<I")
_CHUNK_HEAD = 28
"""Bytes of a chunk in front of the name of its compression."""


class Readable(NamedTuple):
    """What to open instead of a recording."""

    paths: list[Path]
    notes: list[str]
    """What was found and done, for the user."""


@contextmanager
def readable(path: Path) -> Iterator[Readable]:
    """Yield what the library can open: the recording itself, or a copy of its whole part while the block runs.

    Raises LogError where not even the begin of a file is whole, and as `verify_mcap` does.
    """
    files = bag_files(path) if path.is_dir() else [path]
    has_metadata = path.is_dir() and (path / "metadata.yaml").is_file()
    odd = _fault_of_metadata(path) if has_metadata and files else None
    has_metadata = has_metadata and odd is None
    with tempfile.TemporaryDirectory(prefix="testbed-") as folder:
        cut, plain = _unpacked_files(files, Path(folder))
        broken = {file for file in plain if file.stat().st_size == 0 or _is_unfinished(file)}
        for file in plain:
            if file.suffix == ".mcap" and file not in broken:
                verify_mcap(file)
        if not broken and not cut and (path.is_file() or has_metadata):
            yield Readable([path] if plain == files else plain, [])
            return
        notes = []
        if not (broken or cut):
            notes.append(f"{odd or 'no metadata.yaml'}: read {_names(files)}")
        if empty := [file for file in plain if file.stat().st_size == 0 and len(plain) > 1]:
            notes.append(f"{_names(empty)}: empty, left out")
            plain = [file for file in plain if file not in empty]
        if unfinished := [file for file in plain if file in broken | cut]:
            notes.append(
                f"{_names(unfinished)}: the recorder was not stopped properly: what is whole is read, the rest is "
                "left out"
            )
        yield Readable([_repaired(file, Path(folder), path) if file in broken else file for file in plain], notes)


def _unpacked_files(files: list[Path], folder: Path) -> tuple[set[Path], list[Path]]:
    """Files without the packing of whole files, in a folder; and those of them whose packed file ends too early."""
    cut, plain = set(), []
    for file in files:
        if file.suffix != PACKED:
            plain.append(file)
            continue
        plain.append(folder / file.stem)
        with file.open("rb") as source, plain[-1].open("wb") as out:
            unpack = zstd().ZstdDecompressor()
            while not unpack.eof and (part := source.read(1 << 20)):
                out.write(unpack.decompress(part))
            if not unpack.eof:
                cut.add(plain[-1])
    return cut, plain


def _fault_of_metadata(directory: Path) -> str | None:
    """Why the library could not use a metadata.yaml, though the files themselves may be sound; None where it can."""
    import yaml

    try:
        content = yaml.safe_load((directory / "metadata.yaml").read_text(encoding="utf-8"))[
            "rosbag2_bagfile_information"
        ]
        names, version = content["relative_file_paths"], content["version"]
        if not (names and all((directory / name).is_file() for name in names)):
            return "metadata.yaml does not name the files here"
    except (yaml.YAMLError, OSError, UnicodeDecodeError, KeyError, TypeError):
        return "metadata.yaml does not name the files here"
    known = isinstance(version, int) and version <= MAX_METADATA_VERSION
    return None if known else f"metadata.yaml is of version {version}, newer than {MAX_METADATA_VERSION}"


def bag_files(directory: Path) -> list[Path]:
    """The MCAP files of a directory or, where there are none, its SQLite files, plain or packed, sorted by name."""
    found = (sorted(directory.glob(f"*{ending}")) for ending in (".mcap", ".db3", f".mcap{PACKED}", f".db3{PACKED}"))
    return next((files for files in found if files), [])


def is_packed(file: Path) -> bool:
    """Whether a file of a bag is packed as a whole, by its name."""
    return file.suffix == PACKED and Path(file.stem).suffix in (".mcap", ".db3")


def _names(files: list[Path]) -> str:
    return ", ".join(file.name for file in files)


def _is_unfinished(file: Path) -> bool:
    with file.open("rb") as stream:
        head = stream.read(4096)
        size = stream.seek(0, 2)
        if file.suffix == ".db3":
            has_journal = any(file.with_name(file.name + ending).is_file() for ending in JOURNALS)
            return has_journal or size < _stated_size(head)
        if head.startswith(ROS1_MAGIC):
            at = head.find(b"index_pos=")
            position = struct.unpack_from("<Q", head, at + 10)[0] if 0 <= at <= len(head) - 18 else 0
            return not 0 < position <= size
        stream.seek(max(size - len(MAGIC), 0))
        return head.startswith(MAGIC) and stream.read() != MAGIC


def _repaired(file: Path, folder: Path, bag: Path) -> Path:
    """The whole part of a file of a bag as a file in a folder; LogError, naming the bag, where there is none."""
    copy = folder / "whole" / file.name
    copy.parent.mkdir(exist_ok=True)
    if file.suffix == ".db3":
        for ending in ("", *JOURNALS):
            if (part := file.with_name(file.name + ending)).is_file():
                shutil.copyfile(part, copy.with_name(copy.name + ending))
        _finish_sqlite(copy, bag)
    elif file.suffix == ".bag":
        _index_rosbag1(file, copy)
    else:
        _finish_mcap(file, copy)
    return copy


def _stated_size(head: bytes) -> int:
    """Bytes of an SQLite file by its head."""
    if len(head) < _SQLITE_HEAD:
        return _SQLITE_HEAD
    (count,) = struct.unpack_from(">I", head, 28)
    return page_size(head) * int(count)


def _finish_sqlite(copy: Path, bag: Path) -> None:
    """Play back the journal of a data base; where its end is missing, keep the messages up to there."""
    with copy.open("rb") as stream:
        missing = _stated_size(stream.read(_SQLITE_HEAD)) - copy.stat().st_size
    base = sqlite3.connect(copy)
    if missing <= 0:
        base.execute("PRAGMA journal_mode = DELETE")  # plays the journal back
        base.execute("SELECT COUNT(*) FROM messages").fetchone()
        base.close()
        return
    base.execute("PRAGMA writable_schema = ON")  # else a file that is too short is not opened at all
    cut = copy.with_name(f"{copy.name}.cut")
    with sqlite3.connect(cut) as whole:
        for (text,) in base.execute("SELECT sql FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'"):
            whole.execute(text)
        for table in ("topics", "schema", "message_definitions"):
            with suppress(sqlite3.DatabaseError):  # the end of what is whole, or a table of newer bags only
                for row in base.execute(f"SELECT * FROM {table} NOT INDEXED"):
                    whole.execute(f"INSERT INTO {table} VALUES ({','.join('?' * len(row))})", row)
        columns = "id, topic_id, timestamp, data"
        whole.executemany(f"INSERT OR IGNORE INTO messages ({columns}) VALUES (?, ?, ?, ?)", message_rows(copy))
        whole.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        kept = whole.execute("SELECT COUNT(*) FROM messages").fetchone()[0]
    whole.close()
    base.close()
    if not kept:
        raise LogError(f"{bag}: {missing} bytes are missing at its end, and with them all messages")
    cut.replace(copy)


def _finish_mcap(file: Path, copy: Path) -> None:
    """Copy the records that are whole, and end them as a file without a summary ends."""
    with file.open("rb") as source, copy.open("wb") as out:
        size, at = _end_of_content(source), len(MAGIC)
        rest = b""
        while at + RECORD.size <= size:
            source.seek(at)
            kind, length = RECORD.unpack(source.read(RECORD.size))
            if kind in (DATA_END, FOOTER):
                break
            if at + RECORD.size + length > size:
                rest = _whole_part(source.read(size - at - RECORD.size), kind)
                break
            at += RECORD.size + length
        if at == len(MAGIC):
            raise LogError(f"{file}: damaged MCAP file: ends at byte {size} within its first record")
        source.seek(0)
        _copy(source, out, at)
        out.write(rest)
        out.write(RECORD.pack(DATA_END, 4) + bytes(4))
        out.write(RECORD.pack(FOOTER, FOOTER_CONTENT.size) + bytes(FOOTER_CONTENT.size) + MAGIC)


def _end_of_content(source: BinaryIO) -> int:
    """Where a file ends, without the zeros that a power cut leaves at its end [bytes]."""
    end = source.seek(0, 2)
    while end:
        begin = max(end - (1 << 20), 0)
        source.seek(begin)
        part = source.read(end - begin).rstrip(b"\0")
        if part:
            return begin + len(part)
        end = begin
    return 0


def _whole_part(content: bytes, kind: int) -> bytes:
    """The whole records in the begin of a chunk, unpacked; nothing where it is no chunk."""
    if kind != CHUNK or len(content) < _CHUNK_HEAD + 4:
        return b""
    begin = _CHUNK_HEAD + 4
    end = begin + int(_LENGTH.unpack_from(content, _CHUNK_HEAD)[0])
    content = _begin_of_packed(bytes(content[begin:end]), content[end + 8 :])
    at = 0
    while at + RECORD.size <= len(content):
        end = at + RECORD.size + RECORD.unpack_from(content, at)[1]
        if end > len(content):
            break
        at = end
    return content[:at]


def _begin_of_packed(compression: bytes, data: bytes) -> bytes:
    """What the begin of a packed chunk unpacks to; nothing where it was packed in an unknown way."""
    if compression == b"zstd":
        return bytes(zstd().ZstdDecompressor().decompress(data))
    if compression == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        return bytes(LZ4FrameDecompressor().decompress(data))
    return b"" if compression else data


def _copy(source: BinaryIO, out: BinaryIO, size: int) -> None:
    while size and (part := source.read(min(size, 1 << 20))):
        out.write(part)
        size -= len(part)


def _index_rosbag1(file: Path, copy: Path) -> None:
    """Write the messages of the whole chunks of a bag as a bag with an index."""
    from rosbags.rosbag1 import Writer

    connections: dict[int, Any] = {}
    with Writer(copy) as writer, file.open("rb") as source:
        source.seek(len(ROS1_MAGIC))
        for fields, data in _records(source):
            chunk = fields.get(b"compression")
            for inner, content in [(fields, data)] if chunk is None else _parsed(_unpacked(chunk, data)):
                _take_rosbag1(writer, connections, inner, content)


def _take_rosbag1(writer: Any, connections: dict[int, Any], fields: dict[bytes, bytes], data: bytes) -> None:
    from rosbags.typesys.msg import normalize_msgtype

    operation = fields.get(b"op")
    if operation == b"\x07":
        (number,) = _LENGTH.unpack(fields[b"conn"])
        about = _fields(data)
        if number not in connections:
            connections[number] = writer.add_connection(
                fields[b"topic"].decode(),
                normalize_msgtype(about[b"type"].decode()),
                msgdef=about[b"message_definition"].decode(),
                md5sum=about[b"md5sum"].decode(),
            )
    elif operation == b"\x02":
        seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
        (number,) = _LENGTH.unpack(fields[b"conn"])
        writer.write(connections[number], seconds * 1_000_000_000 + nanoseconds, data)


def _records(source: BinaryIO) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """The records of a ROS 1 bag that are whole: fields of the head, and content."""
    while True:
        parts = []
        for _ in range(2):
            size = source.read(4)
            content = source.read(_LENGTH.unpack(size)[0]) if len(size) == 4 else b""
            if len(size) < 4 or len(content) < _LENGTH.unpack(size)[0]:
                return
            parts.append(content)
        yield _fields(parts[0]), parts[1]


def _parsed(content: bytes) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    from io import BytesIO

    return _records(BytesIO(content))


def _fields(content: bytes) -> dict[bytes, bytes]:
    """`name=value` pairs, each behind its length."""
    fields, at = {}, 0
    while at + 4 <= len(content):
        (size,) = _LENGTH.unpack_from(content, at)
        name, _, value = content[at + 4 : at + 4 + size].partition(b"=")
        fields[name] = value
        at += 4 + size
    return fields


def _unpacked(compression: bytes, data: bytes) -> bytes:
    if compression == b"bz2":
        return bz2.decompress(data)
    if compression == b"lz4":
        from lz4.frame import decompress  # rosbags brings it along

        return bytes(decompress(data))
    return data
