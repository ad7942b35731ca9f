# SPDX-License-Identifier: MIT
"""The error that a user of sweeps can correct."""


class SweepError(ValueError):
    """The sweep cannot be done as requested. The message is one line: which setting or file, and what was expected."""
