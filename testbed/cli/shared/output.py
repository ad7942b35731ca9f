# SPDX-License-Identifier: MIT
"""Options of `run` and `slam` for results and views."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from eval.limits import Limit
from testbed.run.run_directory import RunDirectory, default_directory
from testbed.views import ViewOptions

FLAG = Parameter(negative=())
"""A switch that is off by default and has no `--no-…` form."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Directory of the results, limits and views."""

    out: Path | None = None
    """Directory of the run; default: a new one below runs/."""
    overwrite: Annotated[bool, FLAG] = False
    """Replace the run in --out."""
    fail_if: tuple[str, ...] = ()
    """Exit with status 1 if this holds, e.g. 'trajectory.ate_rmse_m > 0.05' (keys of metrics.json); may be repeated."""
    view: Annotated[bool, FLAG] = False
    """Open the Rerun viewer and show the run live."""
    serve: Annotated[bool, FLAG] = False
    """Serve the live view to a web browser on this machine."""
    connect: str | None = None
    """Address of a running Rerun viewer (rerun+http://…)."""

    def __post_init__(self) -> None:
        _ = self.limits, self.view_options  # complain before the run, not after it

    def check_directory(self) -> None:
        """Check --out before anything takes time; raises RunDirectoryError."""
        if self.out is not None:
            RunDirectory.check(self.out, overwrite=self.overwrite)

    def directory(self, name: str) -> RunDirectory:
        """Create the directory of this run, or empty it."""
        return RunDirectory.create(self.out or self.default_path(name), overwrite=self.overwrite)

    @staticmethod
    def default_path(name: str) -> Path:
        """Return a new directory below runs/, which is not made yet."""
        return default_directory(name, datetime.now())

    @property
    def limits(self) -> list[Limit]:
        """The limits of --fail-if."""
        return [Limit.parse(text) for text in self.fail_if]

    @property
    def view_options(self) -> ViewOptions:
        """Live views of the run."""
        return ViewOptions(window=self.view, serve=self.serve, connect=self.connect)


OUTPUT = OutputOptions()
