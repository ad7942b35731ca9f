# SPDX-License-Identifier: MIT
"""One run: frames go through an estimator into a run directory, and are scored."""
