# SPDX-License-Identifier: MIT
"""One system of a comparison: its name, what to write about it, and how to run it on a recording."""

from __future__ import annotations

import shlex
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from slam.config import FilterConfig
from testbed.frame import Frame
from testbed.systems.errors import SystemsError
from testbed.systems.feeding import Cost, Estimated, Step, feed
from testbed.systems.finding import (
    BUILT_IN_PROGRAMS,
    checked_class,
    made_from,
    make_system,
    settings_of,
    short_name,
)
from testbed.systems.program import DatasetFormat, Program, program_name
from testbed.systems.protocol import System, SystemClass


class Entrant(Protocol):
    """A system as comparisons and sweeps see it, whether a Python class or another program."""

    @property
    def name(self) -> str:
        """Name of its directory and in tables."""
        ...

    def facts(self) -> dict[str, Any]:
        """Name, version and settings, for `config.toml`; raises SystemsError where it cannot be made."""
        ...

    def run(self, frames: Sequence[Frame], seed: int, step: Step | None = None) -> tuple[Estimated, Cost]:
        """Run it on a recording; raises SystemFailedError, or SystemsError where it cannot be made."""
        ...


@dataclass(frozen=True)
class ClassEntrant(ABC):
    """A system that is a class which follows `testbed.systems.protocol.System`: each run gets a new instance of it."""

    seconds: float | None = field(default=None, kw_only=True)
    """Time limit of one call of a method [s]; None = none."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of its directory and in tables."""

    @abstractmethod
    def make(self) -> System:
        """Make a new instance; raises SystemsError where it cannot be made."""

    def facts(self) -> dict[str, Any]:
        """Name, version and settings, for `config.toml`; raises SystemsError where it cannot be made."""
        return facts_of(self.make())

    def run(self, frames: Sequence[Frame], seed: int, step: Step | None = None) -> tuple[Estimated, Cost]:
        """Run a new instance of it on a recording, see `testbed.systems.feeding.feed`."""
        return feed(self.make(), self.name, frames, seed, step, seconds=self.seconds)


@dataclass(frozen=True)
class PythonSystem(ClassEntrant):
    """A class that is named."""

    text: str
    """A name, or FILE.py:CLASS."""
    settings: Mapping[str, object] = field(default_factory=dict)
    """Values by dotted name that differ from the defaults."""

    @property
    def name(self) -> str:
        """Name of its directory and in tables."""
        return short_name(self.text)

    def make(self) -> System:
        """Make a new instance; raises SystemsError where it cannot be made."""
        return make_system(self.text, self.settings)


@dataclass(frozen=True)
class ClassSystem(ClassEntrant):
    """A class that is at hand, such as one of a notebook."""

    cls: SystemClass
    settings: Mapping[str, object] = field(default_factory=dict)
    """Values by dotted name that differ from the defaults."""

    @property
    def name(self) -> str:
        """Name of the class."""
        return self.cls.__name__

    def make(self) -> System:
        """Make a new instance; raises SystemsError where the class lacks a part of the protocol, or cannot be made."""
        name = getattr(self.cls, "__name__", repr(self.cls))
        return made_from(checked_class(name, self.cls), name, self.settings)


def filter_settings(text: str, config: FilterConfig, *, refine: bool, threads: int | None) -> dict[str, object]:
    """Return settings of this package's filter that a system has, by name; empty where it is not made of that filter.

    Raises SystemsError for an unknown system.
    """
    settings = getattr(make_system(text), "settings", None)
    if not isinstance(getattr(settings, "filter", None), FilterConfig):
        return {}
    given = {"filter": config, "refine": refine, "threads": threads}
    return {name: value for name, value in given.items() if hasattr(settings, name)}


def facts_of(system: System) -> dict[str, Any]:
    """Name, version and settings of a system, for `config.toml`."""
    return {"name": system.name, "version": system.version, "settings": settings_of(system)}


def entrant_of(text: str, log_format: DatasetFormat = "rosbag2") -> PythonSystem | Program:
    """Return the system of a text: a command where `{dataset}` is in it, else a name or FILE.py:CLASS.

    Raises SystemsError for a program that is not installed.
    """
    if "{dataset}" in text:
        return Program(command=text, log_format=log_format)
    return built_in_program(text) if text in BUILT_IN_PROGRAMS else PythonSystem(text)


def built_in_program(name: str) -> Program:
    """Return a program that the package knows by name; raises SystemsError where it is not installed."""
    known = BUILT_IN_PROGRAMS[name]
    if not known.is_installed:
        raise SystemsError(f"{name}: needs {known.program}: {known.install_command}")
    command = f"{shlex.quote(sys.executable)} {known.command}"
    return Program(command=command, log_format="parquet", label=name, version=known.version)


def name_of(text: str) -> str:
    """Return the name of the system of a text, which need not be there."""
    return program_name(text) if "{dataset}" in text else short_name(text)
