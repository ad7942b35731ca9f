# SPDX-License-Identifier: MIT
"""Rao-Blackwellized grid mapping (gMapping): feed scans and odometry, read pose, map and diagnostics.

`GMapping` is the filter, `FilterConfig` its settings, `Scan` its input, `StepReport` its report on each scan,
`OccupancyGrid` the resulting map; `Recording` feeds a filter and keeps what the final pass needs, which is `refine`;
`Localization` tracks a robot in a finished map; `save_checkpoint` and `load_checkpoint` keep a whole filter in a file.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from slam.checkpoint import load_checkpoint, save_checkpoint
    from slam.config import FilterConfig
    from slam.gmapping import GMapping
    from slam.localization import Localization
    from slam.occupancy import OccupancyGrid
    from slam.recording import Recording
    from slam.refinement.refine import Refined, refine
    from slam.scan import Scan
    from slam.step.step_report import StepReport

__all__ = [
    "FilterConfig",
    "GMapping",
    "Localization",
    "OccupancyGrid",
    "Recording",
    "Refined",
    "Scan",
    "StepReport",
    "load_checkpoint",
    "refine",
    "save_checkpoint",
]

_HOMES = {
    "FilterConfig": "slam.config",
    "GMapping": "slam.gmapping",
    "Localization": "slam.localization",
    "OccupancyGrid": "slam.occupancy",
    "Recording": "slam.recording",
    "Refined": "slam.refinement.refine",
    "Scan": "slam.scan",
    "StepReport": "slam.step.step_report",
    "load_checkpoint": "slam.checkpoint",
    "refine": "slam.refinement.refine",
    "save_checkpoint": "slam.checkpoint",
}


def __getattr__(name: str) -> object:
    """Load public names on first use: `import slam.se2` must not load the compiler (0.5 s)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'slam' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value
