# SPDX-License-Identifier: MIT
"""The filter of this package as a system, with its final pass, and as a plain scan matcher."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from slam.config import FilterConfig
from testbed.systems.filter_system import FilterSystem


@dataclass(frozen=True, kw_only=True)
class GMappingSettings:
    """Settings of the filter and of its final pass."""

    filter: FilterConfig = field(default_factory=FilterConfig)
    """Settings of the filter."""
    refine: bool = True
    """Whether all poses and the map are re-estimated after the last scan (final pass)."""
    threads: int | None = None
    """Threads; None = all cores. The result does not depend on it."""


class GMappingSystem(FilterSystem):
    """The particle filter of `slam.gmapping` and the final pass; the same bits as `testbed run` without --system."""

    def __init__(self, settings: GMappingSettings | None = None) -> None:
        self.settings = settings or GMappingSettings()
        super().__init__(self.settings.filter, refine=self.settings.refine, threads=self.settings.threads)


@dataclass(frozen=True, kw_only=True)
class ScanMatchingSettings:
    """Settings of the scan matcher: those of the filter, but for one particle that is put where its scan fits best."""

    filter: FilterConfig = field(default_factory=FilterConfig)
    """Settings of the filter."""
    threads: int | None = None
    """Threads; None = all cores. The result does not depend on it."""


class ScanMatchingSystem(FilterSystem):
    """The filter with one particle and without final pass: each scan is matched with the one map, which is kept."""

    name = "scan-matching"

    def __init__(self, settings: ScanMatchingSettings | None = None) -> None:
        chosen = settings or ScanMatchingSettings()
        proposal = replace(chosen.filter.proposal, kind="scan-match")
        adapt = replace(chosen.filter.adapt, count="fixed")
        single = replace(chosen.filter, particles=1, proposal=proposal, adapt=adapt)
        self.settings = replace(chosen, filter=single)
        super().__init__(single, refine=False, threads=chosen.threads)
