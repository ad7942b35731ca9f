# SPDX-License-Identifier: MIT
"""Settings of the simulator and of the estimator as people give them, on a command line or in a file."""
