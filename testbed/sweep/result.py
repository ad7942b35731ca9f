# SPDX-License-Identifier: MIT
"""The result of a cell as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

MEASURED = ("wall_s", "peak_rss_mb", "realtime_factor", "filter_s", "us_per_update_per_particle")
"""Measures that differ from run to run; they are stored separately so that everything else is equal byte for byte."""


@dataclass(frozen=True)
class CellResult:
    """The result of a cell, ready for JSON."""

    metrics: dict[str, Any]
    """Content of `metrics.json` of a run without `MEASURED`, and `features` of world, route and sensors."""
    curves: dict[str, list[float | None]]
    """Filter health along the run, columns of equal length: `share` of the updates done, in (0, 1]; `ess` (effective
    sample size) and `unique_ancestors` as shares of the particles; `nees`."""
    timing: dict[str, float | None]
    """`MEASURED` except the memory, and `cell_s`, the whole time of the cell [s]."""
