# SPDX-License-Identifier: MIT
"""Settings: one frozen dataclass for each part of the estimator, checked when it is made."""
