# SPDX-License-Identifier: MIT
"""The code version: a hash that says which code a result comes from."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import slam
import testbed
import worlds
from eval import scoring
from testbed.provenance import versions

PACKAGES = tuple(Path(str(module.__file__)).parent for module in (slam, scoring, worlds, testbed))
SUFFIXES = {".py", ".toml"}
"""Suffixes of source files, and of the worlds and presets in the packages."""


@cache
def code_version() -> str:
    """Hash of all our source files and of the versions of the libraries, 16 hex digits.

    Only the content counts, not the state of a repository: an installed wheel and a working tree agree.
    """
    digest = hashlib.sha256(repr(sorted(versions().items())).encode())
    for package in PACKAGES:
        for path in sorted(package.rglob("*")):
            if path.suffix in SUFFIXES and path.is_file():
                digest.update(f"\0{package.name}/{path.relative_to(package).as_posix()}\0".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
