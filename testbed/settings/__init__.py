# SPDX-License-Identifier: MIT
"""Settings of the simulator and of the estimator, as the command line and files state them."""
