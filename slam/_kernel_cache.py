# SPDX-License-Identifier: MIT
"""Where the machine code of the kernels is kept: a folder that nobody else can write, since loading runs what it holds.

numba keeps compiled functions as pickled files. A file that somebody else has put there would run as this user, so a
folder is used only if this user or root owns it, and others can write neither it nor the two folders above it.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import stat
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numba

ROOT_USER = 0
"""Root can do as it likes anyway; a cache that root has made ahead, as in a container, is used by everyone."""
OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH
OTHERS_MAY_ENTER = stat.S_IXGRP | stat.S_IXOTH

_log = logging.getLogger(__name__)


def kernel_files(package: Path) -> list[Path]:
    """All kernel files of a top-level package, at any depth."""
    return sorted(package.rglob("_*_kernels.py"))


@cache
def cache_folder(package: Path) -> Path | None:
    """Folder of the compiled kernels of one top-level package: its name changes when any of its kernel files changes.

    numba's own cache looks at the file of the calling kernel only, and so returns stale code after an edit of a
    function in another file. A folder named by the hash of all kernel files below the package cannot go stale.

    Where the usual place cannot be used, it is one in the folder for temporary files, with a copy of what a usual place
    that cannot be written holds. None if that cannot be used either: then each process compiles what it needs.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    for source in kernel_files(package):
        digest.update(f"{source.relative_to(package)}\n".encode() + source.read_bytes())
    name = f"{package.name}-{digest.hexdigest()[:16]}"
    usual = _usual_root() / "kernels" / name
    reason = _reason_against(usual)
    if reason is None and os.access(usual, os.W_OK):
        return usual
    temporary = Path(tempfile.gettempdir()) / f"slam-testbed-{os.getuid()}" / "kernels" / name
    other_reason = _reason_against(temporary)
    if other_reason is None and not os.access(temporary, os.W_OK):
        other_reason = f"{temporary} cannot be written"
    if other_reason is not None:
        reasons = f"{reason or f'{usual} cannot be written'}; {other_reason}"
        _log.warning("the compiled kernels cannot be kept, so that each run compiles them anew: %s", reasons)
        return None
    if reason is None and not any(temporary.glob("compiled-*")):
        shutil.copytree(usual, temporary, dirs_exist_ok=True)
    return temporary


@cache
def announce_compilation(package: Path) -> None:
    """Say in one line, once in a process, that the first scans will take long, where nothing was compiled yet.

    The command line compiles in a process of its own and says so itself (`testbed.kernels`).
    """
    folder = cache_folder(package)
    if folder is not None and next(folder.rglob("*.nbc"), None) is None:
        _log.warning("compiling the kernels: about half a minute at the first scans, once per version")


def _usual_root() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(os.environ.get("TESTBED_CACHE") or os.path.join(home, "slam-testbed"))


def _reason_against(folder: Path) -> str | None:
    """Why a folder `ROOT/kernels/NAME` cannot be trusted or made; None = it is there, and nobody else can write it."""
    root = folder.parents[1]
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        for place in (root, folder.parent, folder):
            place.mkdir(mode=0o700, exist_ok=True)
            status = place.stat() if place == root else place.lstat()
            if status.st_uid not in (os.getuid(), ROOT_USER) or not stat.S_ISDIR(status.st_mode):
                return f"{place} belongs to another user"
            sticky = place == root and status.st_mode & stat.S_ISVTX  # as /tmp: others cannot replace what is in it
            if status.st_mode & OTHERS_MAY_WRITE and not sticky:
                return f"{place} can be written by others"
        return _reason_against_content(folder)
    except OSError as error:
        return f"{error.filename or folder}: {(error.strerror or str(error)).lower()}"
    return None


def _reason_against_content(folder: Path) -> str | None:
    """Why what lies in a folder cannot be trusted, such as a file from when the folder could be written by others."""
    is_closed = not folder.stat().st_mode & OTHERS_MAY_ENTER  # as we make it: who cannot enter can write nothing in it
    for place in folder.rglob("*"):
        status = place.lstat()
        if status.st_uid not in (os.getuid(), ROOT_USER):
            return f"{place} belongs to another user"
        if status.st_mode & OTHERS_MAY_WRITE and not is_closed and not stat.S_ISLNK(status.st_mode):
            return f"{place} can be written by others"
    return None


class GuardedCache:
    """The files of one kernel, as numba keeps them; what cannot be read there is compiled again."""

    def __init__(self, files: Any) -> None:
        """files: the cache that numba has made for the kernel."""
        self._files = files

    def __getattr__(self, name: str) -> Any:
        return getattr(self._files, name)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the machine code for a signature; None if it is not there, or damaged."""
        try:
            return self._files.load_overload(sig, target_context)
        except Exception as error:  # damaged bytes raise anything when they are unpickled
            what = f"{type(error).__name__}: {str(error)[:80]}"
            _log.warning("%s: damaged machine code, compiled again (%s)", self._files.cache_path, what)
            self._files.flush()
            return None
