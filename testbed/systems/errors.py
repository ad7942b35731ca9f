# SPDX-License-Identifier: MIT
"""The two errors of systems: one that cannot be started, and one that went wrong on a recording."""


class SystemsError(ValueError):
    """A system cannot be found, made or set up. The message names it and what was expected."""


class SystemFailedError(Exception):
    """A system has no result. The message names the system, the scan and what was expected."""
