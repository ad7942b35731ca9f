# SPDX-License-Identifier: MIT
"""Where an episode takes place: world, start, sensors, wheels."""
