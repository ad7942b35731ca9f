# SPDX-License-Identifier: MIT
"""One run: an estimator processes frames, and the result is scored and written into a run directory."""
