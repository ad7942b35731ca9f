# SPDX-License-Identifier: MIT
"""Many robots of one kind, simulated together."""
