# SPDX-License-Identifier: MIT
"""What is in a recording, and what of it is doubtful: without truth, before anything is mapped."""

from testbed.inspect.finding import Finding, notes_of
from testbed.inspect.reading import AS_STATED, Reading
from testbed.inspect.recording import inspect_log

__all__ = ["AS_STATED", "Finding", "Reading", "inspect_log", "notes_of"]
