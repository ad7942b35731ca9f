# SPDX-License-Identifier: MIT
"""The systems that can be run by name, and what is found when one is checked."""

from __future__ import annotations

from dataclasses import dataclass

from testbed.library import html
from testbed.systems.check import Finding, check_system
from testbed.systems.entrant import ClassSystem, PythonSystem
from testbed.systems.finding import Listed, listed
from testbed.systems.protocol import SystemClass


@dataclass(frozen=True, repr=False)
class Systems:
    """A list that shows itself as a table."""

    found: tuple[Listed, ...]

    @property
    def names(self) -> list[str]:
        """Names of those whose packages are installed."""
        return [system.name for system in self.found if not system.missing]

    def __repr__(self) -> str:
        """A line for each system."""
        return "\n".join(f"{system.name}: {system.summary}" for system in self.found)

    def _repr_html_(self) -> str:
        rows = [(system.name, system.summary, system.missing) for system in self.found]
        return html.table(("system", "what it is", "to install"), rows)


def systems() -> Systems:
    """Return the systems of the package, and those that other packages announce."""
    return Systems(tuple(listed()))


@dataclass(frozen=True, repr=False)
class Check:
    """What was tried of a system, and what was found."""

    findings: tuple[Finding, ...]

    @property
    def is_ok(self) -> bool:
        """Whether nothing breaks the protocol; warnings may remain."""
        return all(finding.level != "error" for finding in self.findings)

    def __repr__(self) -> str:
        """A line for each thing that was tried."""
        return "\n".join(f"{finding.level:<8}{finding.text}" for finding in self.findings)

    def _repr_html_(self) -> str:
        return html.table(("", "what was tried"), [(finding.level, finding.text) for finding in self.findings])


def check(system: str | SystemClass) -> Check:
    """Try a system on a short drive, as `testbed systems check` does; a name, FILE.py:CLASS, or a class.

    Raises SystemsError where it cannot be made.
    """
    return Check(tuple(check_system(PythonSystem(system) if isinstance(system, str) else ClassSystem(system))))
