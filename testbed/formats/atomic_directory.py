# SPDX-License-Identifier: MIT
"""Files and directories that appear under their name only when they are whole."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testbed.formats.log import LogError


@contextmanager
def renamed_when_whole(path: Path) -> Iterator[Path]:
    """Where to write what is to become `path`: the same name in a folder of its own, since files of bags are named
    after their directory. If the block ends early nothing is left, and a complaint of it (LogError) names `path`; what
    a killed one left is removed by the next."""
    aside = path.parent / f".{path.name}.writing" / path.name
    shutil.rmtree(aside.parent, ignore_errors=True)
    aside.parent.mkdir(parents=True)
    try:
        yield aside
        aside.replace(path)
    except LogError as error:
        raise LogError(str(error).replace(str(aside), str(path))) from None
    finally:
        shutil.rmtree(aside.parent, ignore_errors=True)
