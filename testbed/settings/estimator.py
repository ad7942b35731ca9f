# SPDX-License-Identifier: MIT
"""Options that `run` and `slam` share."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from slam.config import FilterConfig

FILTER_GROUP = Group("Filter", sort_key=10)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class EstimatorOptions:
    """The estimator."""

    particles: int | None = None
    """Number of particles (short for --filter.particles)."""
    seed: int = 0
    """All random numbers follow from it."""
    threads: int | None = None
    """Threads of the filter; default: all cores. The result does not depend on it."""
    refine: bool = True
    """Go over the whole recording once more at the end; the filter's own path stays in filter.tum."""
    config: Path | None = None
    """TOML file with settings, such as the config.toml of an earlier run, or the preset `gmapping` (the classic
    parameter values); the command line wins."""
    filter: Annotated[FilterConfig, Parameter(group=FILTER_GROUP)] = field(default_factory=FilterConfig)
    """Settings of the filter."""

    def __post_init__(self) -> None:
        if self.threads is not None and self.threads < 1:
            raise ValueError(f"threads must be at least 1, got {self.threads}")

    @property
    def filter_config(self) -> FilterConfig:
        """Settings of the filter with the number of particles asked for."""
        return self.filter if self.particles is None else replace(self.filter, particles=self.particles)

    def settings(self) -> dict[str, Any]:
        """What of this belongs into `config.toml`: whatever decides the result."""
        return {"seed": self.seed, "refine": self.refine, "filter": asdict(self.filter_config)}


ESTIMATOR = EstimatorOptions()
