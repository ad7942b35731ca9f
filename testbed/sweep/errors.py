# SPDX-License-Identifier: MIT
"""The one error that sweeps raise for what a user can put right."""


class SweepError(ValueError):
    """A sweep cannot be done as asked; the message is one line that names the place and what was expected."""
