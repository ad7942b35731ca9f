# SPDX-License-Identifier: MIT
"""Exit statuses of the command line."""

GATE_FAILED = 1
"""A limit of `--fail-if` is broken, or the run failed."""
USAGE_ERROR = 2
"""The user can put it right: usage, input files, settings, disk space."""
INTERRUPTED = 130
"""Ctrl-C, as shells have it: 128 + SIGINT."""
