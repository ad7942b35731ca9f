# SPDX-License-Identifier: MIT
"""The code version: a hash that says which code a result comes from."""

from __future__ import annotations

import hashlib
import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path

import slam
import testbed
import worlds
from eval import scoring
from testbed.provenance import versions

PACKAGES = tuple(Path(str(module.__file__)).parent for module in (slam, scoring, worlds, testbed))
GIT_SECONDS = 10.0
"""Time after which git is not waited for any longer [s]."""
SUFFIXES = {".py", ".toml"}
"""Suffixes of source files, and of the worlds and presets in the packages."""


@cache
def code_version() -> str:
    """Hash of all our source files and of the versions of the libraries, 16 hex digits, as this process began.

    Only the content counts, not the state of a repository: an installed wheel and a working tree agree.
    """
    return current_code_version()


def current_code_version() -> str:
    """The code version by the files as they are now."""
    digest = hashlib.sha256(repr(sorted(versions().items())).encode())
    for package in PACKAGES:
        for path in sorted(package.rglob("*")):
            if path.suffix in SUFFIXES and path.is_file():
                digest.update(f"\0{package.name}/{path.relative_to(package).as_posix()}\0".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def commit() -> str:
    """What to check out or install to get this code: `git describe` of its repository, else the package version.

    `-dirty` at the end: files of the repository were changed after that commit.
    """
    root = Path(str(testbed.__file__)).parent.parent
    if (root / ".git").exists():
        command = ["git", "-C", str(root), "describe", "--always", "--dirty"]
        with suppress(OSError, subprocess.SubprocessError):
            done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=GIT_SECONDS)
            return done.stdout.strip()
    return f"slam-testbed {versions()['slam-testbed']}"
