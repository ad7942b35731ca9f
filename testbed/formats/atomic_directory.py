# SPDX-License-Identifier: MIT
"""Files and directories that appear under their name only when they are whole."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testbed.formats.log import LogError


@contextmanager
def atomic_directory(path: Path) -> Iterator[Path]:
    """Yield a temporary path of the same name, which becomes `path` when the block ends well.

    The temporary path keeps the name, in a folder of its own, because files of bags are named after their directory.
    If the block fails, nothing is left, and a LogError of the block names `path`. A killed process leaves its folder,
    which the next writer of `path` removes.
    """
    temporary = path.parent / f".{path.name}.writing" / path.name
    shutil.rmtree(temporary.parent, ignore_errors=True)
    temporary.parent.mkdir(parents=True)
    try:
        yield temporary
        temporary.replace(path)
    except LogError as error:
        raise LogError(str(error).replace(str(temporary), str(path))) from None
    finally:
        shutil.rmtree(temporary.parent, ignore_errors=True)
