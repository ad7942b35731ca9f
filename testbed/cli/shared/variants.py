# SPDX-License-Identifier: MIT
"""`--vary KEY=A,B,C`: the same drive with other sensors, so that differences between results have one cause.

Only settings that do not change the robot's path may vary. All other random numbers stay the same.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from pydantic import TypeAdapter, ValidationError

from testbed.presets import PresetError, load_lidar, load_robot
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation import LidarLayers, OdometryConfig, SurfaceConfig

GROUPS = {"odometry": OdometryConfig, "layers": LidarLayers, "surface": SurfaceConfig}
KEYS = {
    **dict.fromkeys(("lidar", "beams", "noise", "clutter"), SimulatorOptions),
    **{f"{group}.{field.name}": owner for group, owner in GROUPS.items() for field in fields(owner)},
}
"""Settings that may vary, and the class of each."""


PRESETS: dict[str, Callable[[str], object]] = {"robot": load_robot, "lidar": load_lidar}
"""Settings that name a preset, and what loads it."""


class Variant(NamedTuple):
    """One variant of the sensors of a drive."""

    name: str
    """Part of the names of its datasets; empty without `--vary`."""
    simulator: SimulatorOptions
    """Settings of the variant."""


def variants(simulator: SimulatorOptions, vary: Sequence[str]) -> list[Variant]:
    """Return all combinations of the values.

    Raises ValueError for keys that are unknown or change the path, and for invalid values.
    """
    axes = [_axis(text) for text in vary]
    if len({key for key, _ in axes}) < len(axes):
        raise ValueError(f"--vary names a key twice: {', '.join(key for key, _ in axes)}")
    found = []
    for values in itertools.product(*(values for _, values in axes)):
        changed = simulator
        for (key, _), value in zip(axes, values, strict=True):
            changed = with_value(changed, key, value, "--vary")
        names = (
            f"{key}-{Path(value).name.removesuffix('.toml')}" for (key, _), value in zip(axes, values, strict=True)
        )
        found.append(Variant(re.sub(r"[^A-Za-z0-9.-]+", "_", "-".join(names)), changed))
    if len({variant.name for variant in found}) < len(found):
        raise ValueError(f"--vary gives variants the same name: {', '.join(variant.name for variant in found)}")
    return found


def _axis(text: str) -> tuple[str, list[str]]:
    key, equals, values = text.partition("=")
    key = key.strip().replace("-", "_")
    if key not in KEYS:
        raise ValueError(f"--vary {text}: expected KEY=A,B,C with a key that keeps the path: {', '.join(KEYS)}")
    chosen = [value.strip() for value in values.split(",")]
    if not equals or "" in chosen:
        raise ValueError(f"--vary {text}: expected {key}=A,B,C")
    return key, chosen


def with_value(simulator: SimulatorOptions, key: str, text: str, option: str) -> SimulatorOptions:
    """Return the settings with another value of `key`, given as text.

    option: name of the command-line option, for messages. Raises ValueError where the value is invalid.
    """
    group, _, name = key.rpartition(".")
    owner = GROUPS.get(group, SimulatorOptions)
    try:
        converted: Any = TypeAdapter(get_type_hints(owner)[name]).validate_python(text)
    except ValidationError as error:
        raise ValueError(f"{option} {key}={text}: {error.errors(include_url=False)[0]['msg']}") from None
    if key in PRESETS:
        for preset in converted.split(",") if key == "lidar" else [converted]:
            try:
                PRESETS[key](preset.strip())
            except PresetError as error:
                raise ValueError(f"{option} {key}={text}: {error}") from None
    if not group:
        return replace(simulator, **{name: converted})
    return replace(simulator, **{group: replace(getattr(simulator, group), **{name: converted})})


def value_of(simulator: SimulatorOptions, key: str) -> Any:
    """Return the value of `key`."""
    group, _, name = key.rpartition(".")
    return getattr(getattr(simulator, group) if group else simulator, name)
