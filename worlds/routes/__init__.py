# SPDX-License-Identifier: MIT
"""Routes through a world that are drawn by seed: all of its tour, in another order from another start."""

from worlds.routes.random_route import random_route

__all__ = ["random_route"]
