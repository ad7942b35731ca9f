# SPDX-License-Identifier: MIT
"""The filter in a finished map as a system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from slam.config import FilterConfig, LocalizationConfig
from testbed.estimation.known_map import KnownMap
from testbed.systems.errors import SystemsError
from testbed.systems.filter_system import FilterSystem
from testbed.systems.protocol import Lidar


@dataclass(frozen=True, kw_only=True)
class LocalizationSettings:
    """The map, the start, and the settings of the filter in it."""

    map: Path | None = None
    """Finished map (map_server `.yaml`); it must be given."""
    start: str | None = None
    """Approximate start in the map's frame as X,Y,DEG [m, deg]; None = unknown."""
    localization: LocalizationConfig = field(default_factory=LocalizationConfig)
    """Settings of the localisation."""
    filter: FilterConfig = field(default_factory=FilterConfig)
    """Settings of the filter."""
    threads: int | None = None
    """Threads; None = all cores. The result does not depend on it."""


class LocalizationSystem(FilterSystem):
    """Tracks the robot in a map that is given; the map is no result of it."""

    name = "localization"

    def __init__(self, settings: LocalizationSettings | None = None) -> None:
        self.settings = settings or LocalizationSettings()
        super().__init__(self.settings.filter, refine=False, threads=self.settings.threads)

    @property
    def makes_map(self) -> bool:
        """False: the map is given, and is no result."""
        return False

    def start(self, lidars: Sequence[Lidar], seed: int) -> None:
        """Read the map. Raises SystemsError where none is given, ValueError where it cannot be used."""
        chosen = self.settings
        if chosen.map is None:
            raise SystemsError("localization: needs a map, expected --system-set localization.map=FILE.yaml")
        self._known_map = KnownMap.read(chosen.map, chosen.start, chosen.localization, None)
        super().start(lidars, seed)
