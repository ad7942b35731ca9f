# SPDX-License-Identifier: MIT
"""Files and directories that are whole or not there: written under a temporary name, then renamed.

Three kinds: `atomic_write` replaces a file, `atomic_directory` makes a directory, `create_once` makes a file unless
there is one. A temporary name is `.NAME.HOST.PROCESS.tmp`, so that processes on several computers do not collide.
"""

from __future__ import annotations

import errno
import glob
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path to write a file to; rename it to `path` at the end, remove it if an error was raised.

    Raises OSError that names `path` where it cannot be written, or the folder where that does not exist.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such directory", str(path.parent))
    temporary = _temporary(path)
    try:
        yield temporary
        temporary.replace(path)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        _name_target(error, temporary, path)
        raise


@contextmanager
def atomic_directory(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a path at which to make a directory, or a file, that is to become `path`; rename it at the end.

    The last part of the yielded path equals that of `path`, since some writers name files after their directory.
    Missing parents are made. An error leaves nothing behind, and its message names `path`. What killed processes
    of this computer left of the same `path` is removed first. Raises FileExistsError where `path` is a directory with
    files in it at the end.
    """
    path = Path(path)
    discard_unfinished(path)
    temporary = _temporary(path) / path.name
    temporary.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield temporary
        try:
            temporary.replace(path)
        except OSError as error:
            if error.errno not in {errno.ENOTEMPTY, errno.EEXIST}:
                raise
            raise FileExistsError(errno.EEXIST, "exists", str(path)) from None
    except BaseException as error:
        _name_target(error, temporary, path)
        raise
    finally:
        shutil.rmtree(temporary.parent, ignore_errors=True)


def create_once(path: str | os.PathLike[str], text: str) -> bool:
    """Write `text` to a new file `path`, whole as soon as it is there; False, and no change, where there is one.

    Of several processes that start together exactly one writes it.
    """
    path = Path(path)
    temporary = _temporary(path)
    try:
        temporary.write_text(text, encoding="utf-8")
        path.hardlink_to(temporary)
    except FileExistsError:
        return False
    except OSError as error:
        _name_target(error, temporary, path)
        raise
    finally:
        temporary.unlink(missing_ok=True)
    return True


def discard_unfinished(path: str | os.PathLike[str]) -> None:
    """Remove what unfinished writers of `path` left: this process, and killed ones of this computer."""
    path = Path(path)
    for left in path.parent.glob(f".{glob.escape(path.name)}.{glob.escape(socket.gethostname())}.*.tmp"):
        process = left.name.removesuffix(".tmp").rpartition(".")[2]
        if process.isdecimal() and (int(process) == os.getpid() or not _is_running(int(process))):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.{socket.gethostname()}.{os.getpid()}.tmp")


def _is_running(process: int) -> bool:
    with suppress(PermissionError):  # it runs, and belongs to another user
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
    return True


def _name_target(error: BaseException, temporary: Path, path: Path) -> None:
    """Let the message of an error name the file that was asked for, not the temporary one."""
    if isinstance(error, OSError) and error.errno is not None:
        copied_to = error.filename2 if error.errno == errno.ENOSPC else None  # what is copied comes first
        named = str(copied_to or error.filename or path)
        error.filename = named.replace(str(temporary), str(path))
    else:
        error.args = tuple(
            argument.replace(str(temporary), str(path)) if isinstance(argument, str) else argument
            for argument in error.args
        )
