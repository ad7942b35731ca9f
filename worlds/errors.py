# SPDX-License-Identifier: MIT
"""The errors of worlds and of their files."""

from __future__ import annotations

import reprlib
from typing import Any

MAX_QUOTED = 160
"""Largest number of characters that a message quotes of a file."""


class WorldError(ValueError):
    """A world cannot be used; the message is one line that names the file, the place in it, and what was expected."""


class MapFileError(WorldError):
    """A map file cannot be read or written; the message names the file, the key and what was expected."""


def shown(value: Any) -> str:
    """A value of a file as a message quotes it: what is long is shortened, so that what was expected has room."""
    return reprlib.repr(value)[:MAX_QUOTED]
