# SPDX-License-Identifier: MIT
"""Routes through a world that are drawn by seed: its tour in another order, or to random stops on all floor."""

from worlds.routes.random_route import random_route
from worlds.routes.stops_route import stops_route

__all__ = ["random_route", "stops_route"]
