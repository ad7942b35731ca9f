# SPDX-License-Identifier: MIT
"""What decides where the simulated robot drives."""
