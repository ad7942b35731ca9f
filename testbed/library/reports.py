# SPDX-License-Identifier: MIT
"""Sweeps and stress tests: the commands `testbed sweep` and `testbed stress`, whose pages show themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from eval.survival.page import PAGE as STRESS_PAGE
from eval.survival.results import Run, read_runs
from eval.sweep.results import SweepTable, read_sweep
from testbed.cli.shared.status import INTERRUPTED
from testbed.cli.shared.sweep_answers import say_answers, say_systems
from testbed.cli.shared.sweep_options import Execution, SweepOptions
from testbed.cli.stress import StressOptions
from testbed.cli.stress import stress as stress_command
from testbed.cli.sweep import sweep as sweep_command
from testbed.library import html
from testbed.library.drive import AnyPath
from testbed.sweep.spec.settings import Value
from testbed.sweep.store import SweepDirectory


@dataclass(frozen=True, repr=False)
class Report:
    """The directory of a sweep or stress test: printed its results, in a notebook its page."""

    path: Path
    page: str
    """Name of the page in it."""

    @property
    def table(self) -> SweepTable:
        """All figures of a sweep, by world, line, particle count and seed."""
        return read_sweep(self.path)

    @property
    def runs(self) -> Sequence[Run]:
        """All runs of a stress test."""
        return read_runs(self.path)

    def __repr__(self) -> str:
        """The lines that the command ends with."""
        lines = [f"<Report {self.path / self.page}>"]
        if self.page == STRESS_PAGE:
            return "\n".join([*lines, (self.path / "table.md").read_text(encoding="utf-8").rstrip()])
        names_systems = SweepDirectory.open(self.path).manifest.spec.names_systems
        (say_systems if names_systems else say_answers)(self.path, lines.append)
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html.frame((self.path / self.page).read_text(encoding="utf-8"))


def sweep(
    worlds: Sequence[str],
    *,
    out: AnyPath,
    systems: Sequence[str] = (),
    particles: Sequence[int] = (),
    seeds: int = 10,
    settings: Mapping[str, Value] | None = None,
    workers: int | None = None,
) -> Report:
    """Measure accuracy over worlds and seeds: of systems, or of this package's filter over particle counts.

    out: directory; an unfinished sweep in it is completed. systems: names, or FILE.py:CLASS
    settings: values by dotted name of all runs; workers: processes, None = one for each core
    """
    request = SweepOptions(
        worlds=",".join(worlds),
        particles=",".join(map(str, particles)) or None,
        seeds=str(seeds),
        system=",".join(systems) or None,
        set=_texts(settings),
    )
    _done(sweep_command(request=request, out=Path(out), execution=_execution(workers), worst=False))
    return Report(Path(out), "sweep.html")


def stress(
    systems: Sequence[str],
    worlds: Sequence[str],
    *,
    out: AnyPath,
    perturbations: Sequence[str] = (),
    seeds: int = 5,
    duration: float = 120.0,
    settings: Mapping[str, Value] | None = None,
    workers: int | None = None,
) -> Report:
    """Find how much of each perturbation systems survive; perturbations: names of docs/stress.md, none = all."""
    options = StressOptions(
        worlds=",".join(worlds),
        perturbations=",".join(perturbations) or None,
        seeds=str(seeds),
        duration=duration,
        set=_texts(settings),
    )
    _done(stress_command(",".join(systems), options=options, out=Path(out), execution=_execution(workers)))
    return Report(Path(out), STRESS_PAGE)


def _texts(settings: Mapping[str, Value] | None) -> tuple[str, ...]:
    """Settings as the command line takes them."""
    given = (settings or {}).items()
    return tuple(f"{name}={str(value).lower() if isinstance(value, bool) else value}" for name, value in given)


def _execution(workers: int | None) -> Execution:
    return Execution() if workers is None else Execution(workers=workers)


def _done(status: int) -> None:
    """Raise KeyboardInterrupt where a command was interrupted; jobs without a result are on its page."""
    if status == INTERRUPTED:
        raise KeyboardInterrupt
