# SPDX-License-Identifier: MIT
"""Drivers that steer by the filter's estimate and never see the truth."""

from testbed.exploration.belief import Belief
from testbed.exploration.explore_driver import ExploreDriver
from testbed.exploration.explorer import STRATEGIES, Explorer, make_explorer

__all__ = ["STRATEGIES", "Belief", "ExploreDriver", "Explorer", "make_explorer"]
