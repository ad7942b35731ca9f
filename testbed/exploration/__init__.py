# SPDX-License-Identifier: MIT
"""Drivers that steer by the estimate: what the mapper believes decides where the robot goes, never the truth."""

from testbed.exploration.belief import Belief
from testbed.exploration.explore_driver import ExploreDriver
from testbed.exploration.explorer import STRATEGIES, Explorer, make_explorer

__all__ = ["STRATEGIES", "Belief", "ExploreDriver", "Explorer", "make_explorer"]
