# SPDX-License-Identifier: MIT
"""Options that `run` and `slam` share."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Group, Parameter

from eval.limits import Limit
from slam.config import FilterConfig
from testbed.run.run_directory import RunDirectory, default_directory
from testbed.seeds import streams
from testbed.views import ViewOptions

FILTER_GROUP = Group("Filter", sort_key=10)
FLAG = Parameter(negative=())
"""A switch that is off unless it is named: no `--no-…` beside it."""


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
    def filter_seed(self) -> np.random.SeedSequence:
        """The filter's stream of random numbers."""
        return streams(self.seed).filter

    @property
    def filter_config(self) -> FilterConfig:
        """Settings of the filter with the number of particles asked for."""
        return self.filter if self.particles is None else replace(self.filter, particles=self.particles)

    def settings(self) -> dict[str, Any]:
        """What of this belongs into `config.toml`: whatever decides the result."""
        return {"seed": self.seed, "refine": self.refine, "filter": asdict(self.filter_config)}


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Where the results go and what is shown on the way."""

    out: Path | None = None
    """Directory of the run; default: a new one below runs/."""
    overwrite: Annotated[bool, FLAG] = False
    """Replace the run in --out."""
    fail_if: tuple[str, ...] = ()
    """Exit with 1 if this holds, e.g. 'trajectory.ate_rmse_m > 0.05'; keys of metrics.json; may be repeated."""
    view: Annotated[bool, FLAG] = False
    """Open the Rerun viewer and watch live."""
    serve: Annotated[bool, FLAG] = False
    """Serve the live view to a web browser on this machine."""
    connect: str | None = None
    """Address of a Rerun viewer that is running already (rerun+http://…)."""

    def __post_init__(self) -> None:
        _ = self.limits, self.view_options  # complain before the run, not after it

    def check_directory(self) -> None:
        """Complain about --out before anything takes time."""
        if self.out is not None:
            RunDirectory.check(self.out, overwrite=self.overwrite)

    def directory(self, name: str) -> RunDirectory:
        """The directory of this run, made or emptied now."""
        return RunDirectory.create(self.out or default_directory(name, datetime.now()), overwrite=self.overwrite)

    @property
    def limits(self) -> list[Limit]:
        """The limits of --fail-if."""
        return [Limit.parse(text) for text in self.fail_if]

    @property
    def view_options(self) -> ViewOptions:
        """How the run is shown live."""
        return ViewOptions(window=self.view, serve=self.serve, connect=self.connect)


ESTIMATOR = EstimatorOptions()
OUTPUT = OutputOptions()
