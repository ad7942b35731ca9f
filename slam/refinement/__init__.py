# SPDX-License-Identifier: MIT
"""The final pass: all poses of a recording adjusted together, and the map redrawn from them."""

from slam.refinement.refine import Refined, refine

__all__ = ["Refined", "refine"]
