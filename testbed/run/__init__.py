# SPDX-License-Identifier: MIT
"""One run: a system is followed scan by scan, and its result is scored and written into a run directory."""
