# SPDX-License-Identifier: MIT
"""Loading of presets from the package or from a TOML file."""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from testbed.presets.models import LidarPreset, RobotPreset
from worlds.errors import shown
from worlds.regular_file import refuse_devices

MAX_FILE_BYTES = 100_000
"""Largest size of a preset file."""

_Preset = TypeVar("_Preset", RobotPreset, LidarPreset)


class PresetError(ValueError):
    """A preset cannot be used; the message names file, key and what was expected, in one line."""


def robots() -> list[str]:
    """Return the names of the robots of the package, sorted."""
    return _names("robots")


def lidars() -> list[str]:
    """Return the names of the lidars of the package, sorted."""
    return _names("lidars")


def filters() -> list[str]:
    """Return the names of the filter settings of the package, sorted."""
    return _names("filters")


def filter_settings(name: str) -> Path:
    """Return the TOML file of the filter settings of that name."""
    return Path(str(_folder("filters") / f"{name}.toml"))


def load_robot(name_or_path: str | Path) -> RobotPreset:
    """Return the robot of that name or TOML file. Raises `PresetError` for unknown names and invalid files."""
    return _load(RobotPreset, "robot", str(name_or_path))


def load_lidar(name_or_path: str | Path) -> LidarPreset:
    """Return the lidar of that name or TOML file. Raises `PresetError` for unknown names and invalid files."""
    return _load(LidarPreset, "lidar", str(name_or_path))


def _folder(kind: str) -> Traversable:
    return resources.files("testbed") / "presets" / kind


def _names(kind: str) -> list[str]:
    return sorted(entry.name.removesuffix(".toml") for entry in _folder(kind).iterdir() if entry.name.endswith(".toml"))


def _load(model: type[_Preset], kind: str, name: str) -> _Preset:
    text, place = _read(kind, name)
    try:
        return model.model_validate(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise PresetError(f"{place}: {error}, expected TOML") from None
    except ValidationError as error:
        problems = error.errors(include_url=False)
        # a misspelt key is unknown under its own name and missing under the right one: tell the former
        problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
        key = ".".join(str(part) for part in problem["loc"])
        if problem["type"] == "extra_forbidden":
            near = difflib.get_close_matches(str(problem["loc"][-1]), list(model.model_fields), n=1, cutoff=0.5)
            hint = (
                f", expected {near[0]!r}"
                if near
                else f", expected the keys of a {kind}: {', '.join(model.model_fields)}"
            )
            raise PresetError(f"{place}: {key} is not known{hint}") from None
        if problem["type"] == "missing":
            raise PresetError(f"{place}: {key} is missing") from None
        what = problem["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
        given = f"{key} = {shown(problem['input'])}: " if key else ""
        raise PresetError(f"{place}: {given}{what}") from None


def _read(kind: str, name: str) -> tuple[str, str]:
    """Return the text of a preset file and its name in messages."""
    known = _names(f"{kind}s")
    if name in known:
        return (_folder(f"{kind}s") / f"{name}.toml").read_text(encoding="utf-8"), f"{kind} {name!r}"
    path = Path(name)
    if path.suffix != ".toml" and not path.exists():
        near = difflib.get_close_matches(name, known, n=3, cutoff=0.4) or known
        raise PresetError(f"unknown {kind} {name!r}, expected a TOML file or a name such as {', '.join(near)}")
    try:
        refuse_devices(path)
        if path.stat().st_size > MAX_FILE_BYTES:
            raise PresetError(f"{path}: {path.stat().st_size} bytes, expected at most {MAX_FILE_BYTES}")
        return path.read_text(encoding="utf-8"), str(path)
    except OSError as error:
        raise PresetError(f"{path}: {error.strerror}, expected a {kind} preset") from None
    except UnicodeDecodeError as error:
        raise PresetError(f"{path}: byte {error.start} is not UTF-8, expected a TOML text file") from None
