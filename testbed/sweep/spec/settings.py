# SPDX-License-Identifier: MIT
"""Settings by dotted names such as `odometry.grade`; every option of `testbed run` can be an axis."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any, TypeVar, get_type_hints

from pydantic import TypeAdapter, ValidationError

from slam.config import FilterConfig
from slam.config.renamed import present_name
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation.config import decided_backend
from testbed.stress.table import parse_perturbations
from testbed.sweep.errors import SweepError
from testbed.systems.program import DatasetFormat

Value = bool | int | float | str
"""Value of a setting."""
_Config = TypeVar("_Config")

_TOUR_ONLY = "all jobs of a seed share one drive, which is a tour"
NOT_SETTINGS = {
    "filter.particles": "is given as 'particles', not as a setting",
    "driver.kind": _TOUR_ONLY,
    "commands": _TOUR_ONLY,
}
"""Options of `testbed run` that cannot be set in a sweep, and why."""
FILES = ("robot", "lidar", "system")
"""Settings whose value may be a file of the user; of a system `FILE.py:CLASS`."""


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Everything that decides a run except its world or log, its seed and its particle count."""

    simulator: SimulatorOptions = field(default_factory=lambda: SimulatorOptions(backend="fast"))
    filter: FilterConfig = field(default_factory=FilterConfig)
    refine: bool = True
    system: str = ""
    """The SLAM system: a name, FILE.py:CLASS or a command (`testbed.systems`); empty = the filter of this package."""
    system_format: DatasetFormat = "rosbag2"
    """Format of the recording for a command."""
    perturb: str = ""
    """Perturbations of the recording, such as `drop-scans=0.3+askew=5` (`testbed.stress.table`)."""

    def __post_init__(self) -> None:
        parse_perturbations(self.perturb)

    @classmethod
    def of(cls, values: Mapping[str, Value]) -> RunSettings:
        """The defaults with these values by dotted name; raises ValueError for values that exclude each other."""
        settings = cls()
        for name, value in values.items():
            settings = _replaced(settings, _path(name), value)
        return settings


@cache
def known() -> dict[str, TypeAdapter[Any]]:
    """Every setting by dotted name, with the validator of its values."""
    return {name: TypeAdapter(kind) for name, kind in _leaves(RunSettings) if name not in NOT_SETTINGS}


def checked(name: str, value: object, *, recorded: bool) -> Value:
    """Validate the value of a setting. `recorded`: the sweep is over logs, so nothing is simulated.

    Raises SweepError for an unknown name (with the most similar ones) and for a value of the wrong type.
    """
    name = present_name(name)
    if name in NOT_SETTINGS:
        raise SweepError(f"{name}: {NOT_SETTINGS[name]}")
    if name not in known():
        near = difflib.get_close_matches(name, known(), n=3, cutoff=0.4) or ["robot", "odometry.grade", "filter.…"]
        raise SweepError(f"{name}: unknown setting, expected such as {', '.join(near)}")
    if recorded and not (name.startswith("filter.") or name in ("refine", "system", "system_format", "perturb")):
        raise SweepError(
            f"{name}: recorded logs are not simulated, expected a filter setting, 'refine', 'system' or 'perturb'"
        )
    try:
        validated = known()[name].validate_python(value, strict=True)
    except ValidationError as error:
        what = error.errors(include_url=False)[0]["msg"].replace("Input should be", "expected")
        raise SweepError(f"{name} = {value!r}: {what}") from None
    if name == "backend":
        validated = decided_backend(validated)  # jobs of one sweep have the same, wherever they run
    if not isinstance(validated, Value):
        raise SweepError(f"{name}: expected one word, number or switch, got {value!r}")
    try:
        RunSettings.of({name: validated})
    except ValueError as error:
        raise SweepError(f"{name} = {value!r}: {error}") from None
    return validated


def _path(name: str) -> list[str]:
    """Field names from `RunSettings` to a setting; settings of the simulator are one level deeper."""
    name = present_name(name)
    head = name.partition(".")[0]
    inside = {f.name for f in fields(RunSettings)}
    return name.split(".") if head in inside else ["simulator", *name.split(".")]


def _replaced(config: _Config, path: list[str], value: Value) -> _Config:
    """Copy of a frozen dataclass with one (nested) field replaced."""
    head, *rest = path
    inner = _replaced(getattr(config, head), rest, value) if rest else value
    return replace(config, **{head: inner})  # type: ignore[type-var]  # configs are dataclasses


def _leaves(config: type, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and types of all fields that are not themselves dataclasses."""
    hints = get_type_hints(config)
    for f in fields(config):
        kind = hints[f.name]
        if not is_dataclass(kind):
            yield f"{prefix}{f.name}", kind
        elif f.name == "simulator":
            yield from _leaves(kind, prefix)  # type: ignore[arg-type]
        else:
            yield from _leaves(kind, f"{prefix}{f.name}.")  # type: ignore[arg-type]
