# SPDX-License-Identifier: MIT
"""The particles of a system that has some, kept while it runs, for the recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.systems.errors import SystemFailedError
from testbed.systems.protocol import System

MAX_PARTICLES = 500
"""So many are kept of one scan; of more, every k-th."""
EXPECTED = "expected (poses (n, 3), weights (n,)) of finite numbers, no weight negative, or None"


@dataclass(frozen=True)
class KeptParticles:
    """Particles at scans, as the system had them while driving."""

    by_scan: dict[int, tuple[Pose, NDArray[np.float64]]] = field(default_factory=dict)
    """`T_map_robot` (n, 3) and weights (n,) by the number of the scan; scans without particles are missing."""

    def add(self, scan: int, system: System, label: str) -> None:
        """Ask a system for its particles after a scan, if it has any; SystemFailedError where they are none."""
        particles = particles_of(system)
        if particles is None:
            return
        try:
            given = particles()
        except (Exception, SystemExit) as error:
            raise SystemFailedError(f"{label}: particles raised {type(error).__name__}: {error}, {EXPECTED}") from error
        if given is not None:
            poses, weights = _checked(given, label)
            every = slice(None, None, max(1, -(-len(weights) // MAX_PARTICLES)))
            self.by_scan[scan] = poses[every], weights[every]


def particles_of(system: System) -> Callable[[], Any] | None:
    """The method `particles` of a system; None where it has none (an attribute of that name is something else)."""
    found = getattr(system, "particles", None)
    return found if callable(found) else None


def _checked(given: object, label: str) -> tuple[Pose, NDArray[np.float64]]:
    """Copies of the poses (n, 3) and weights (n,) that a system has returned."""
    try:
        poses, weights = (np.array(part, dtype=np.float64) for part in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise SystemFailedError(f"{label}: particles returned a {type(given).__name__}, {EXPECTED}") from None
    if poses.ndim != 2 or poses.shape[1] != 3 or weights.shape != poses.shape[:1]:
        shapes = f"arrays of shapes {poses.shape} and {weights.shape}"
        raise SystemFailedError(f"{label}: particles returned {shapes}, {EXPECTED}")
    if not (np.isfinite(poses).all() and np.isfinite(weights).all() and (weights >= 0.0).all()):
        raise SystemFailedError(f"{label}: particles returned numbers that are not finite, or below zero, {EXPECTED}")
    return poses, weights
