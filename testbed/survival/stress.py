# SPDX-License-Identifier: MIT
"""A stress test: which runs it needs next, and what it has found.

Its directory is that of a sweep over the systems on the drives as they are, whose cells are stored as they are there;
the perturbed runs are further cells of it. In each turn all systems get one more drive, with each perturbation at the
severity that `eval.survival.threshold` chooses. That follows from the stored results alone, so that a stress test which
was interrupted goes on with the same runs.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eval.survival.page import write_stress_page
from eval.survival.results import NO_RESULT, UNPERTURBED, Run, Scale, write_runs
from eval.survival.threshold import ThresholdSearch
from testbed.stress.table import Perturbation, text_of
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.command import grouped
from testbed.sweep.spec.conditions import conditions
from testbed.sweep.store import SweepDirectory


@dataclass(frozen=True)
class Trial:
    """One run that is needed."""

    cell: Cell
    perturbation: str
    severity: float | None
    """None for the drive as it is."""
    value: float | None


class StressTest:
    """The runs of some systems under some perturbations, turn by turn."""

    def __init__(self, directory: SweepDirectory, perturbations: Sequence[Perturbation]) -> None:
        """directory: of the sweep over the systems, whose specification has one particle count and no variants"""
        self.directory, self.perturbations = directory, tuple(perturbations)
        self.runs: list[Run] = []
        """The runs of all turns that are complete."""
        self.turn = 0
        """Number of turns that are complete."""
        cells = directory.manifest.cells()
        self.lines = list(dict.fromkeys(cell.line for cell in cells))
        """Names of the systems."""
        self._plain = {(cell.place, cell.line, cell.seed): cell for cell in cells}
        places = list(dict.fromkeys(cell.place for cell in cells))
        self.drives = [(place, seed) for seed in directory.manifest.spec.seeds for place in places]
        """World or log and seed of each turn."""
        self._searches = {(line, row.name): ThresholdSearch() for line in self.lines for row in self.perturbations}

    @property
    def size(self) -> int:
        """Number of all runs."""
        return len(self.drives) * len(self.lines) * (1 + len(self.perturbations))

    def trials(self) -> list[Trial]:
        """The runs of the next turn; empty where there is none."""
        if self.turn == len(self.drives):
            return []
        place, seed = self.drives[self.turn]
        plain = {line: self._plain[place, line, seed] for line in self.lines}
        found = [Trial(plain[line], UNPERTURBED, None, None) for line in self.lines]
        for row in self.perturbations:  # those at one severity follow each other: they have one recording
            of_row = [_perturbed(plain[line], row, self._searches[line, row.name]) for line in self.lines]
            found += sorted(of_row, key=lambda trial: trial.severity or 0.0)
        return found

    def is_done(self, trial: Trial) -> bool:
        """Whether a run has ended, with a result or without."""
        return self.directory.is_done(trial.cell.key) or self.directory.reason(trial.cell.key) is not None

    def finish_turn(self, trials: Sequence[Trial]) -> None:
        """Take in the results of a turn; all of its runs must be done."""
        runs = [self._run(trial) for trial in trials]
        for trial, run in zip(trials, runs, strict=True):
            if trial.severity is not None:
                self._searches[trial.cell.line, trial.perturbation].add(trial.severity, failed=run.has_failed)
        self.runs += runs
        self.turn += 1

    def write(self, trials: Sequence[Trial] = ()) -> Path:
        """Write the table and the page of what there is and return the path of the page.

        trials: those of a turn that is not complete; those that are done are shown too
        """
        runs = [*self.runs, *(self._run(trial) for trial in trials if self.is_done(trial))]
        order = [UNPERTURBED, *(row.name for row in self.perturbations)]
        runs.sort(key=lambda run: (self.lines.index(run.system), order.index(run.perturbation), run.turn))
        command = self.command
        write_runs(self.directory.path, runs, {"command": command, "code": self.directory.manifest.code})
        scales = {row.name: Scale(row.unit, row.summary, row.value_at) for row in self.perturbations}
        return write_stress_page(self.directory.path, runs, scales, about=self._about(len(runs)), command=command)

    @property
    def command(self) -> str:
        """The command that makes the same runs, without --out."""
        spec = self.directory.manifest.spec
        systems = list(map(str, spec.axes["system"]))
        seeds = ",".join(map(str, spec.seeds)) + ("," if len(spec.seeds) == 1 else "")
        words = ["testbed", "stress", ",".join(system for system in systems if "{dataset}" not in system)]
        for program in systems:
            words += ["--system-command", program] if "{dataset}" in program else []
        words += ["--worlds", ",".join(grouped(spec.worlds))] if spec.worlds else []
        for log in spec.logs:
            references = [f",{name}={getattr(log, name)}" for name in ("relations", "truth") if getattr(log, name)]
            words += ["--log", "".join([log.log, *references])]
        words += ["--seeds", seeds]
        words += ["--perturbations", ",".join(row.name for row in self.perturbations)]
        words += ["--particles", str(spec.particles[0])]
        for name, value in spec.settings.items():
            words += ["--set", f"{name}={str(value).lower() if isinstance(value, bool) else value}"]
        return shlex.join(words)

    def _about(self, done: int) -> str:
        spec = self.directory.manifest.spec
        places = ", ".join([*grouped(spec.worlds), *(log.name for log in spec.logs)])
        return (
            f"{done} of {self.size} runs: {len(self.drives)} drives ({places}; {len(spec.seeds)} seeds), each with "
            f"every system and perturbation. Systems see the same frames wherever they get the same severity. With: "
            f"{conditions(spec)}."
        )

    def _run(self, trial: Trial) -> Run:
        """How a run that is done ended."""
        cell, key = trial.cell, trial.cell.key
        result = self.directory.result(key)
        metrics = {} if result is None else result.metrics
        reason = metrics.get("outcome_reason", "") if result is not None else self.directory.reason(key)
        return Run(
            system=cell.line,
            perturbation=trial.perturbation,
            severity=trial.severity,
            value=trial.value,
            place=cell.place,
            seed=cell.seed,
            turn=self.drives.index((cell.place, cell.seed)),
            outcome=str(metrics.get("outcome", NO_RESULT)),
            reason=str(reason or ""),
            key=key,
        )


def _perturbed(plain: Cell, row: Perturbation, search: ThresholdSearch) -> Trial:
    """The next run of a system with a perturbation on a drive."""
    severity = search.next_severity
    value = row.value_at(severity)
    settings = {**plain.settings, "perturb": text_of({row.name: value})}
    return Trial(replace(plain, settings=settings), row.name, severity, value)
