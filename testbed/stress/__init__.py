# SPDX-License-Identifier: MIT
"""Faults at a known time, as filters on frames: the same for simulated and recorded drives."""
