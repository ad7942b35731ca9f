# SPDX-License-Identifier: MIT
"""The errors of worlds and of their files."""

from __future__ import annotations


class WorldError(ValueError):
    """A world cannot be used; the message is one line that names the file, the place in it, and what was expected."""


class MapFileError(WorldError):
    """A map file cannot be read or written; the message names the file, the key and what was expected."""
