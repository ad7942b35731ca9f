# SPDX-License-Identifier: MIT
"""Exit statuses of the command line."""

GATE_FAILED = 1
"""A limit of `--fail-if` is broken, or the run failed."""
USAGE_ERROR = 2
"""Error that the user can fix: usage, input files, settings, disk space."""
INTERRUPTED = 130
"""Interrupted by Ctrl-C: 128 + SIGINT, as in shells."""
