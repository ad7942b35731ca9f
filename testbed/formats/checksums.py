# SPDX-License-Identifier: MIT
"""SHA-256 of the files of a dataset and of the messages of a bag: most formats would not notice a changed byte."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from testbed.formats.log import LogError
from testbed.provenance import versions
from testbed.toml import dump_toml

CONFIG = "config.toml"
MAX_CONFIG = 1_000_000
"""Bytes."""


SEAL_TOPIC = "/testbed/sha256"
"""Topic of the last message of a bag: the sum over all others, as a std_msgs/String."""


class MessageSum:
    """Sum of the SHA-256 of all messages of a bag, modulo 2^256: their order does not matter, since messages of one
    time have none."""

    def __init__(self) -> None:
        self._sum = 0

    def add(self, topic: str, time: int, raw: bytes | memoryview) -> None:
        """Take in a message; time [ns], raw: as it is in the bag."""
        digest = hashlib.sha256(f"{topic} {time} ".encode())
        digest.update(raw)
        self._sum += int.from_bytes(digest.digest(), "big")

    @property
    def text(self) -> str:
        """The sum as 64 hexadecimal digits."""
        return f"{self._sum % 2**256:064x}"


def checksums_of(directory: Path) -> dict[str, str]:
    """SHA-256 of each file of a directory but `config.toml`, by name."""
    return {path.name: _sha256(path) for path in sorted(directory.iterdir()) if path.name != CONFIG}


def seal_directory(directory: Path, document: Mapping[str, Any]) -> None:
    """Write `config.toml`: the document, versions, and the SHA-256 of all files that are there by now."""
    whole = {**document, "versions": versions(), "checksums": checksums_of(directory)}
    (directory / CONFIG).write_text(dump_toml(whole), encoding="utf-8")


def verify(directory: Path) -> None:
    """Compare the files of a dataset with the `[checksums]` in its `config.toml`, where there is one.

    Raises LogError, naming the file, where one is missing or has changed.
    """
    config = directory / CONFIG
    if not config.is_file():
        return
    if config.stat().st_size > MAX_CONFIG:
        raise LogError(f"{config}: larger than {MAX_CONFIG} bytes")
    try:
        written = tomllib.loads(config.read_text(encoding="utf-8")).get("checksums", {})
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise LogError(f"{config}: {error}, expected TOML") from None
    if not isinstance(written, dict):
        raise LogError(f"{config}: checksums: expected a table of file names and SHA-256 sums")
    for name, digest in written.items():
        path = directory / name
        if Path(name).name != name:
            raise LogError(f"{config}: checksums: {name!r} is no file of this directory")
        if not path.is_file():
            raise LogError(f"{path}: missing; it belongs to this dataset")
        if _sha256(path) != digest:
            raise LogError(f"{path}: has changed since the dataset was written (SHA-256 differs)")


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
