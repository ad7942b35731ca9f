# SPDX-License-Identifier: MIT
"""Drivers, which decide where the simulated robot drives."""
