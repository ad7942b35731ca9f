# SPDX-License-Identifier: MIT
"""What makes a drive harder to map, as filters on frames: the same for simulated and recorded drives."""
