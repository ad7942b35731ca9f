# SPDX-License-Identifier: MIT
"""What the self-check remembers, to and from plain values fit for JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

Part = TypeVar("Part")


def part_of(kind: Callable[..., Part], values: Mapping[str, Any] | None) -> Part | None:
    """A dataclass with a `place` from what `asdict` and JSON made of it; None stays None."""
    return None if values is None else kind(**{**values, "place": plain_pose(values["place"])})


def plain_pose(pose: ArrayLike) -> tuple[float, float, float]:
    """A pose (3,) as plain numbers."""
    x, y, theta = np.asarray(pose, dtype=np.float64).tolist()
    return x, y, theta
