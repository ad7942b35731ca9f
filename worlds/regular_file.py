# SPDX-License-Identifier: MIT
"""What is read whole must be a file: a device such as /dev/zero never ends, and a pipe that nobody writes hangs."""

from __future__ import annotations

import errno
import stat
from pathlib import Path


def refuse_devices(path: Path) -> None:
    """Raise OSError where a path is, or leads to, anything but a file or a directory, or where nothing is there."""
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "is a device or a pipe, not a file", str(path))
