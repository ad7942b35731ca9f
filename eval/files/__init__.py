# SPDX-License-Identifier: MIT
"""Files that the measures read and write: trajectories, maps, run directories; every write is atomic."""
