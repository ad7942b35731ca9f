# SPDX-License-Identifier: MIT
"""Rao-Blackwellized grid mapping (gMapping): feed scans and odometry, read pose, map and diagnostics.

`GMapping` is the filter, `FilterConfig` its settings, `Scan` what it eats, `OccupancyGrid` the map that comes out,
`refine` the final pass over a recording.
"""

from slam.config import FilterConfig
from slam.gmapping import GMapping, StepReport
from slam.occupancy import OccupancyGrid
from slam.refine import Refined, refine
from slam.scan import Scan

__all__ = ["FilterConfig", "GMapping", "OccupancyGrid", "Refined", "Scan", "StepReport", "refine"]
