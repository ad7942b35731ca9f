# SPDX-License-Identifier: MIT
"""Systems by name: those of the package, those of other packages (entry points), and classes in a file of the user."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import re
import shutil
import subprocess
import sys
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import TypeAdapter, ValidationError

from testbed.systems.errors import SystemsError
from testbed.systems.protocol import System, SystemClass

GROUP = "slam_testbed.systems"
"""Entry point group in which other packages announce their systems."""


@dataclass(frozen=True)
class BuiltIn:
    """A system that comes with the package."""

    target: str
    """`module:class`."""
    summary: str
    modules: tuple[str, ...] = ()
    """Modules of other packages that it needs."""
    extra: str = ""
    """Extra of this package that installs them."""

    @property
    def is_installed(self) -> bool:
        """Whether the modules that it needs are there."""
        return all(importlib.util.find_spec(module) is not None for module in self.modules)


DEFAULT = "gmapping"
"""The system where none is named."""
BUILT_IN = {
    DEFAULT: BuiltIn("testbed.systems.gmapping:GMappingSystem", "the filter of this package, with its final pass"),
    "localization": BuiltIn("testbed.systems.localization:LocalizationSystem", "the filter in a finished map"),
    "odometry": BuiltIn("testbed.systems.odometry:OdometrySystem", "what the wheels say: the baseline"),
    "scan-matching": BuiltIn(
        "testbed.systems.gmapping:ScanMatchingSystem", "the filter with one particle, without final pass"
    ),
    "karto": BuiltIn(
        "testbed.systems.karto:KartoSystem",
        "Karto's scan matcher with pose graph and loops (yag-slam)",
        modules=("yag_slam", "cv2"),
        extra="karto",
    ),
    "kiss-icp": BuiltIn(
        "testbed.systems.kiss_icp:KissIcpSystem",
        "ICP on flat clouds, without wheels (KISS-ICP)",
        modules=("kiss_icp",),
        extra="kiss-icp",
    ),
}
"""Systems of the package by name."""


@dataclass(frozen=True)
class BuiltInProgram:
    """A program of others that the package knows how to run, see `testbed.systems.program`."""

    command: str
    """Words after the Python interpreter, with `{dataset}`, `{out}` and `{seed}`."""
    summary: str
    program: str
    """The program that is called in the end."""
    package: str
    """Debian's package that holds it."""

    @property
    def is_installed(self) -> bool:
        """Whether the program is there."""
        return shutil.which(self.program) is not None

    @property
    def install_command(self) -> str:
        """The command that installs it."""
        return f"apt-get install {self.package}"

    @property
    def version(self) -> str:
        """Version of the package, where Debian's tools are there."""
        query = ["dpkg-query", "--show", "--showformat=${Version}", self.package]
        try:
            found = subprocess.run(query, capture_output=True, text=True, check=False)
        except OSError:
            return "unknown"
        return f"{self.package} {found.stdout}" if found.returncode == 0 else "unknown"


BUILT_IN_PROGRAMS = {
    name: BuiltInProgram(
        command=f"-m testbed.systems.mrpt {program} {{dataset}} {{out}} {{seed}}",
        summary=summary,
        program=program,
        package="mrpt-apps",
    )
    for name, program, summary in (
        ("mrpt-icp", "icp-slam", "ICP with a map of points (MRPT)"),
        ("mrpt-rbpf", "rbpf-slam", "Rao-Blackwellised particle filter with optimal sampling (MRPT)"),
    )
}
"""Programs that the package knows by name."""


@dataclass(frozen=True)
class Listed:
    """A system in the list."""

    name: str
    summary: str
    missing: str = ""
    """How to install what it needs; empty where nothing is missing."""


def listed() -> list[Listed]:
    """Return the systems of the package and those that other packages announce."""
    own = [Listed(name, b.summary, "" if b.is_installed else install_command(b)) for name, b in BUILT_IN.items()]
    own += [
        Listed(name, b.summary, "" if b.is_installed else b.install_command) for name, b in BUILT_IN_PROGRAMS.items()
    ]
    return own + [Listed(point.name, point.value) for point in entry_points(group=GROUP)]


def install_command(entry: BuiltIn) -> str:
    """Return the command that installs what a system needs."""
    return f"pip install 'slam-testbed[{entry.extra}]'"


def find_system(text: str) -> SystemClass:
    """Return the class of a system: a name, or `FILE.py:CLASS`.

    Raises SystemsError where there is none, where it lacks a part of the protocol, or where its packages are missing.
    """
    path, colon, name = text.rpartition(":")
    if colon and path.endswith(".py"):
        return checked_class(text, getattr(_module_of(Path(path), text), name, None))
    if text in BUILT_IN:
        entry = BUILT_IN[text]
        if not entry.is_installed:
            raise SystemsError(f"{text}: needs {', '.join(entry.modules)}: {install_command(entry)}")
        module, _, name = entry.target.partition(":")
        return checked_class(text, getattr(importlib.import_module(module), name))
    if text in BUILT_IN_PROGRAMS:
        raise SystemsError(f"{text}: is a program, which has no class: expected it after --system")
    if "{dataset}" in text:
        raise SystemsError(f"{text!r}: is a command, which has no class: expected it after --system-command")
    points = {point.name: point for point in entry_points(group=GROUP)}
    if text in points:
        try:
            return checked_class(text, points[text].load())
        except (Exception, SystemExit) as error:
            raise SystemsError(f"{text}: cannot be loaded: {describe(error)}") from error
    names = ", ".join([*BUILT_IN, *BUILT_IN_PROGRAMS, *points])
    raise SystemsError(f"system {text!r}: unknown, expected one of {names}, or FILE.py:CLASS")


def file_of(text: str) -> Path | None:
    """Return the file of a system that is given as `FILE.py:CLASS`; None for other systems."""
    path, colon, _ = text.rpartition(":")
    return Path(path) if colon and path.endswith(".py") else None


def make_system(text: str, values: Mapping[str, object] | None = None) -> System:
    """Make a system with its default settings but for `values` (texts are converted to the fields' types).

    Raises SystemsError for an unknown system or setting, for a wrong value, and where the class cannot be made.
    """
    return made_from(find_system(text), text, values)


def made_from(cls: SystemClass, text: str, values: Mapping[str, object] | None = None) -> System:
    """Make a system of a class, see `make_system`; text: its name in messages."""
    try:
        system: System = cls()
        settings = getattr(system, "settings", None)
        if not values:
            return system
        if not dataclasses.is_dataclass(settings) or isinstance(settings, type):
            raise SystemsError(f"{text}: has no settings, expected no {', '.join(values)}")
        made: System = cls(_replaced(text, settings, values))
    except SystemsError:
        raise
    except (Exception, SystemExit) as error:
        raise SystemsError(f"{text}: cannot be made: {describe(error)}") from error
    return made


def settings_of(system: System) -> dict[str, Any]:
    """Return the settings of a system as plain data; empty where it has none."""
    settings = getattr(system, "settings", None)
    if not dataclasses.is_dataclass(settings) or isinstance(settings, type):
        return {}
    return dataclasses.asdict(settings)


def describe(error: BaseException) -> str:
    """Return an exception as one line: its type, its message, and the last line of code of a file that it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if Path(frame.filename).parent != Path(__file__).parent] or list(frames)
    place = f" ({Path(own[-1].filename).name}:{own[-1].lineno})" if own else ""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}{': ' if words else ''}{words}{place}"


def short_name(text: str) -> str:
    """Return a name fit for a directory: of `FILE.py:CLASS` the class."""
    return re.sub(r"[^A-Za-z0-9.-]+", "_", text.rpartition(":")[2] if ".py:" in text else text)


def check_names(names: Iterable[str]) -> None:
    """Raise SystemsError where two systems would have the same directory."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise SystemsError(f"{name}: occurs twice, expected systems of different names")
        seen.add(name)


def _module_of(path: Path, text: str) -> Any:
    """Import a file of the user; modules next to it can be imported too."""
    if not path.is_file():
        raise SystemsError(f"{text}: no such file {path}, expected FILE.py:CLASS")
    spec = importlib.util.spec_from_file_location(f"_system_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise SystemsError(f"{text}: cannot be imported: {describe(error)}") from error
    finally:
        sys.path.remove(folder)
    return module


def checked_class(text: str, found: object) -> SystemClass:
    """Return the class; SystemsError where it is none, or lacks a part of the protocol. text: its name in messages."""
    if not isinstance(found, type):
        raise SystemsError(f"{text}: no such class, expected a class that follows the protocol of docs/systems.md")
    missing = [part for part in ("name", "version", "start", "process", "finish") if not hasattr(found, part)]
    if missing:
        raise SystemsError(f"{text}: lacks {', '.join(missing)}: expected the protocol of docs/systems.md")
    for part in ("name", "version"):
        if not isinstance(getattr(found, part), str | property):
            raise SystemsError(f"{text}: {part} is {getattr(found, part)!r}, expected a text")
    return found


def _replaced(text: str, settings: Any, values: Mapping[str, object]) -> Any:
    """Return the settings with other values by dotted name."""
    for key, value in values.items():
        settings = _with_value(f"{text}.{key}", settings, key.split("."), value)
    return settings


def _with_value(label: str, settings: Any, path: list[str], value: object) -> Any:
    head, *rest = path
    names = [field.name for field in dataclasses.fields(settings)]
    if head not in names:
        raise SystemsError(f"{label}: no such setting, expected one of {', '.join(names)}")
    try:
        if rest:
            inner = getattr(settings, head)
            if not dataclasses.is_dataclass(inner):
                raise SystemsError(f"{label}: {head} holds no further settings")
            return dataclasses.replace(settings, **{head: _with_value(label, inner, rest, value)})
        converted = TypeAdapter(get_type_hints(type(settings))[head]).validate_python(value)
        return dataclasses.replace(settings, **{head: converted})
    except ValidationError as error:
        raise SystemsError(f"{label} = {value}: {error.errors(include_url=False)[0]['msg']}") from None
    except SystemsError:
        raise
    except ValueError as error:
        raise SystemsError(f"{label} = {value}: {error}") from None
