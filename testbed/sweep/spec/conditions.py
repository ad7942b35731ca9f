# SPDX-License-Identifier: MIT
"""Under which conditions the runs of a sweep took place, in words: for its page and for the captions of its tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from testbed.sweep.spec.settings import RunSettings
from testbed.sweep.spec.spec import SweepSpec

_NAMED = (
    "robot",
    "lidar",
    "odometry.grade",
    "backend",
    "filter.gate.distance",
    "filter.gate.angle",
    "route",
    "refine",
    "system",
    "duration",
)
"""Settings that stand in the sentence by themselves, or elsewhere on the page."""


def conditions(spec: SweepSpec) -> str:
    """Robot, lidar, odometry, simulator and update gate of all runs, and further settings that they share.

    What differs between the lines is in their names; here it is `various`.
    """
    settings = [RunSettings.of(line.settings) for line in spec.lines()]

    def shared(value: Callable[[RunSettings], object]) -> str:
        values = {value(single) for single in settings}
        return _text(values.pop()) if len(values) == 1 else "various"

    distance = shared(lambda s: s.filter.gate.distance)
    angle = shared(lambda s: s.filter.gate.angle)
    is_shared = "various" not in (distance, angle)
    words = [f"filter update every {distance} m or {angle} rad" if is_shared else "various update gates"]
    if spec.worlds:
        words = [
            f"robot {shared(lambda s: s.simulator.robot)}",
            f"lidar {shared(lambda s: s.simulator.lidar)}",
            f"odometry {shared(lambda s: s.simulator.odometry.grade)}",
            f"backend {shared(lambda s: s.simulator.backend)}",
            *words,
        ]
    if "duration" in spec.settings:
        words.append(f"at most {_text(spec.settings['duration'])} s of each drive")
    words += [f"{name} = {_text(value)}" for name, value in spec.settings.items() if name not in _NAMED]
    return ", ".join(words)


def _text(value: object) -> str:
    """A value as people write it; of a file its name."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else Path(str(value)).stem
