# SPDX-License-Identifier: MIT
"""Columns of the table of steps (`steps.parquet`), one row for each scan; docs/run-directory.md lists them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, Any]
"""Arrays or lists of one length by column name; None or NaN = unknown."""


def column(steps: Columns, name: str) -> NDArray[np.float64]:
    """Return one column as floats (n,), unknown = NaN; raise ValueError where the table does not have it."""
    if name not in steps:
        raise ValueError(f"the table of steps has no column {name!r}, only {', '.join(sorted(steps))}")
    return np.array([np.nan if value is None else value for value in np.asarray(steps[name]).tolist()], np.float64)


def pose_columns(steps: Columns, prefix: str = "") -> NDArray[np.float64]:
    """Return the columns x, y [m] and theta [rad], with the prefix before their names, as poses (n, 3)."""
    return np.column_stack([column(steps, f"{prefix}{name}") for name in ("x", "y", "theta")])


def updates(steps: Columns) -> NDArray[np.bool_]:
    """Return the rows in which the filter took the scan in, as a mask (n,)."""
    mask: NDArray[np.bool_] = column(steps, "updated") == 1.0
    return mask
