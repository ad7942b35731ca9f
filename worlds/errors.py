# SPDX-License-Identifier: MIT
"""What can be wrong with a world."""

from __future__ import annotations


class WorldError(ValueError):
    """A world cannot be used; the message is one line that names the file, the place in it, and what was expected."""
