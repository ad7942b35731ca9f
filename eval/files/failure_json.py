# SPDX-License-Identifier: MIT
"""`finding.json` of a run directory: where it went wrong, with the end points of that scan's beams."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.files.atomic_write import atomic_write
from eval.first_failure import Finding


@dataclass(frozen=True, eq=False)
class ShownFinding:
    """A finding and what the lidar saw there."""

    finding: Finding
    points: NDArray[np.float64]
    """End points of the beams that hit something, in the robot's frame [m], (k, 2)."""


def write_finding(path: str | os.PathLike[str], finding: Finding, points: ArrayLike) -> None:
    """Write it as JSON; points (k, 2) [m] are kept to the millimetre."""
    document = {
        "scan": finding.scan,
        "since": finding.since,
        "stamp": finding.stamp,
        "bad": finding.bad,
        "reason": finding.reason,
        "believed": finding.believed.tolist(),
        "expected": None if finding.expected is None else finding.expected.tolist(),
        "points": np.round(np.asarray(points, dtype=np.float64).reshape(-1, 2), 3).tolist(),
    }
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def read_finding(path: str | os.PathLike[str]) -> ShownFinding:
    """Read it back; raises ValueError, naming the file, for what is no finding."""
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
        expected = document["expected"]
        finding = Finding(
            scan=int(document["scan"]),
            since=int(document["since"]),
            stamp=float(document["stamp"]),
            bad=bool(document["bad"]),
            reason=str(document["reason"]),
            believed=_numbers(document["believed"], (3,)),
            expected=None if expected is None else _numbers(expected, (3,)),
        )
        return ShownFinding(finding, _numbers(document["points"], (-1, 2)))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: expected a finding as testbed writes it: {error}") from None


def _numbers(values: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64).reshape(shape)
    if not np.isfinite(array).all():
        raise ValueError("a number is not finite")
    return array
