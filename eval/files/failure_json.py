# SPDX-License-Identifier: MIT
"""`finding.json` of a run directory: the moment at which it went wrong, with a scan that shows it."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.files.atomic_write import atomic_write
from eval.first_failure import Blip, Failure

OLD_NAMES = {"believed": "estimated", "expected": "true_pose"}
"""Names of keys in older files, also written for one release."""


@dataclass(frozen=True, eq=False)
class ShownFailure:
    """A failure and the scan that shows it."""

    failure: Failure
    points: NDArray[np.float64]
    """End points of the beams that hit something, in the robot's frame [m], (k, 2)."""


def write_failure(path: str | os.PathLike[str], failure: Failure, points: ArrayLike) -> None:
    """Write a failure as JSON, under a temporary name first; points (k, 2) [m] are rounded to the millimetre."""
    document = {
        "scan": failure.scan,
        "since": failure.since,
        "stamp": failure.stamp,
        "bad": failure.bad,
        "reason": failure.reason,
        "shown_scan": failure.shown_scan,
        "estimated": failure.estimated.tolist(),
        "true_pose": None if failure.true_pose is None else failure.true_pose.tolist(),
        "cause": failure.cause,
        "back": failure.back,
        "blips": [asdict(blip) for blip in failure.blips],
        "points": np.round(np.asarray(points, dtype=np.float64).reshape(-1, 2), 3).tolist(),
    }
    document |= {old: document[new] for old, new in OLD_NAMES.items()}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def read_failure(path: str | os.PathLike[str]) -> ShownFailure:
    """Read a failure; raises ValueError that names the file if it holds none."""
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
        document |= {new: document[old] for old, new in OLD_NAMES.items() if new not in document}
        true_pose = document["true_pose"]
        failure = Failure(
            scan=int(document["scan"]),
            since=int(document["since"]),
            stamp=float(document["stamp"]),
            bad=bool(document["bad"]),
            reason=str(document["reason"]),
            shown_scan=int(document.get("shown_scan", document["scan"])),  # files of older releases have none
            estimated=_numbers(document["estimated"], (3,)),
            true_pose=None if true_pose is None else _numbers(true_pose, (3,)),
            blips=tuple(Blip(**blip) for blip in document.get("blips", ())),
            cause=document.get("cause"),
            back=None if document.get("back") is None else float(document["back"]),
        )
        return ShownFailure(failure, _numbers(document["points"], (-1, 2)))
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: expected finding.json as testbed writes it: {error}") from None


def _numbers(values: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64).reshape(shape)
    if not np.isfinite(array).all():
        raise ValueError("a number is not finite")
    return array
