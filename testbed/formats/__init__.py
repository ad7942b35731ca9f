# SPDX-License-Identifier: MIT
"""Recorded logs, read and written. `open_log(path)` recognises the format from the content."""

from testbed.formats.log import Log, LogError
from testbed.formats.open import open_log

__all__ = ["Log", "LogError", "open_log"]
