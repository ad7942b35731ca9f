# SPDX-License-Identifier: MIT
"""Settings of the estimator."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from slam.config import FilterConfig

if TYPE_CHECKING:
    from testbed.estimation.known_map import KnownMap
    from testbed.systems.filter_system import FilterSystem

FILTER_GROUP = Group("Filter", sort_key=10)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """Settings of the estimator."""

    particles: int | None = None
    """Number of particles (short for --filter.particles)."""
    seed: int = 0
    """Random seed."""
    threads: int | None = None
    """Threads of the filter; default: all cores. They do not change the result."""
    refine: bool = True
    """Refine all poses and the map after the run (final pass); filter.tum keeps the filter's own path."""
    config: Path | None = None
    """TOML file with settings, such as the config.toml of an earlier run, or a preset: gmapping (parameters of the C++
    program) or paper (the filter as in the paper). Options on the command line take precedence."""
    filter: Annotated[FilterConfig, Parameter(group=FILTER_GROUP)] = field(default_factory=FilterConfig)
    """Settings of the filter."""

    def __post_init__(self) -> None:
        if self.threads is not None and self.threads < 1:
            raise ValueError(f"threads must be at least 1, got {self.threads}")

    @property
    def filter_config(self) -> FilterConfig:
        """Settings of the filter, with the number of particles of `particles`."""
        return self.filter if self.particles is None else replace(self.filter, particles=self.particles)

    def system(self, known_map: KnownMap | None = None) -> FilterSystem:
        """Return this package's filter with these settings; known_map: the map to localise in, None = it makes one."""
        from testbed.systems.filter_system import FilterSystem  # here: it brings the kernels along

        return FilterSystem(self.filter_config, refine=self.refine, threads=self.threads, known_map=known_map)

    def settings(self) -> dict[str, Any]:
        """Return the settings that decide the result, for `config.toml`."""
        return {"seed": self.seed, "refine": self.refine, "filter": asdict(self.filter_config)}


ESTIMATOR = EstimatorOptions()
