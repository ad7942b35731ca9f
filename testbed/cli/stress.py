# SPDX-License-Identifier: MIT
"""`testbed stress`."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from eval.sweep.job_times import REPORT_SECONDS, duration_words
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.output import FLAG
from testbed.cli.shared.status import INTERRUPTED
from testbed.cli.shared.sweep_options import EXECUTION, SYSTEMS_PARTICLES, Execution
from testbed.formats import open_log
from testbed.run.run_directory import default_directory
from testbed.stress.table import PERTURBATIONS, Perturbation, find
from testbed.survival.stress import StressTest, Trial
from testbed.sweep.errors import SweepError
from testbed.sweep.execute import check_code, execute, prepare
from testbed.sweep.execution.compute import compute
from testbed.sweep.execution.local_pool import Event, Finished
from testbed.sweep.result import CellResult
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import Costs, input_digests
from testbed.sweep.spec.plan import plan as cells_of
from testbed.sweep.spec.spec import SweepSpec, parse_spec, parsed_axes
from testbed.sweep.store import MANIFEST, SweepDirectory
from worlds import expand_names

DURATION = 120.0
"""Length of a drive unless the user says otherwise [s]."""
REPORT_EVERY = 30.0
"""Without a terminal a line is printed after this time [s]."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class StressOptions:
    """What is tested, and on which drives."""

    worlds: str | None = None
    """Worlds, separated by commas; generated:rooms*5 stands for 5 generated worlds."""
    log: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """A recorded log or dataset directory instead of worlds, with what is known of the truth where it does not hold
    that: LOG, LOG,relations=FILE or LOG,truth=FILE. May be repeated."""
    perturbations: str | None = None
    """Names, separated by commas: the options of `testbed perturb` without dashes, such as drop-scans,slip.
    Default: all."""
    seeds: str = "5"
    """Number of seeds, from 0 on; or a list such as 0,1,2 or a range such as 0:10. Each is a drive in each world."""
    system_command: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """A program as a further system, such as 'my_slam {dataset} {out}', see docs/systems.md. May be repeated."""
    particles: int = SYSTEMS_PARTICLES
    """Particles of the systems that are made of the filter of this package."""
    duration: float | None = None
    """Longest simulated time of a drive [s], default: 120. Logs are run as a whole."""
    set: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """NAME=VALUE: a setting of all runs, as in sweeps, such as lidar=lds01 or odometry.grade=good. May be repeated."""

    def check_drives(self) -> None:
        """Raise ValueError unless either worlds or logs are named."""
        if (self.worlds is None) == (not self.log):
            raise ValueError("expected either --worlds or --log")
        if self.log and self.duration is not None:
            raise ValueError("--duration: logs are run as a whole, expected it with --worlds only")

    @property
    def chosen(self) -> list[Perturbation]:
        """The perturbations. Raises ValueError for an unknown name, or one that needs a truth that is not there."""
        truthless = [name for name, needed in self._truthless.items() if needed]
        if self.perturbations is None:
            return [row for row in PERTURBATIONS.values() if not (row.needs_truth and truthless)]
        names = list(dict.fromkeys(word.strip() for word in self.perturbations.split(",") if word.strip()))
        if not names:
            raise ValueError("--perturbations: is empty, expected names such as drop-scans")
        found = [find(name) for name in names]
        for row in found:
            if row.needs_truth and truthless:
                raise ValueError(f"{row.name}: needs the true pose at each scan, which {truthless[0]} does not have")
        return found

    def specification(self, systems: str) -> SweepSpec:
        """The sweep over the systems on the drives as they are."""
        settings: dict[str, Any] = {name: values[0] for name, values in parsed_axes(self.set).items() if values}
        if "perturb" in settings:
            raise SweepError("--set perturb: is chosen by the stress test, expected --perturbations")
        names = [word.strip() for word in systems.split(",") if word.strip()] + list(self.system_command)
        drives: dict[str, Any] = {"logs": self._sources}
        if self.worlds is not None:
            drives = {"worlds": expand_names(self.worlds)}
            settings = {"route": "random", "duration": self.duration or DURATION, **settings}
        document = {
            **drives,
            "seeds": self.seeds,
            "particles": [self.particles],
            "axes": {"system": names},
            "settings": settings,
        }
        return parse_spec(document, "command line", Path())

    @property
    def _sources(self) -> list[dict[str, str]]:
        """The logs as a specification has them."""
        return [source_of(text) for text in self.log]

    @cached_property
    def _truthless(self) -> dict[str, bool]:
        """Whether a log lacks the true pose of a scan, by its name. Raises ValueError for one without any reference."""
        found = {}
        for source in self._sources:
            lacks = "truth" not in source and not has_truth(source["log"])
            if lacks and "relations" not in source:
                raise ValueError(
                    f"{source['log']}: holds no truth to tell failures by, expected "
                    f"--log {source['log']},relations=FILE or truth=FILE"
                )
            found[source["log"]] = lacks
        return found


STRESS = StressOptions()


def source_of(text: str) -> dict[str, str]:
    """Read LOG, LOG,relations=FILE or LOG,truth=FILE as the entry of a log in a specification.

    Raises ValueError for other text.
    """
    log, *references = text.split(",")
    source = {"log": str(Path(log).resolve())}
    for reference in references:
        kind, _, file = reference.partition("=")
        if kind not in ("relations", "truth") or not file:
            raise ValueError(f"--log {text}: expected LOG, LOG,relations=FILE or LOG,truth=FILE")
        source[kind] = str(Path(file).resolve())
    return source


def has_truth(log: str) -> bool:
    """Whether a log holds the true pose at each scan."""
    table = open_log(Path(log)).table
    return bool(np.isfinite(table.truth[table.scan_rows]).all())


def stress(
    systems: str,
    /,
    *,
    options: StressOptions = STRESS,
    out: Path | None = None,
    execution: Execution = EXECUTION,
    plan: Annotated[bool, FLAG] = False,
) -> int:
    """Find how much of each perturbation SLAM systems survive: the value at which half of the runs fail.

    Parameters
    ----------
    systems
        Names (`testbed systems list`) or FILE.py:CLASS, separated by commas.
    out
        Directory of the stress test; an unfinished one in it is completed. Default: a new one in runs/.
    plan
        Print how many runs there are and how long they will take, and stop. One run of each system is measured.
    """
    if execution.shard is not None:
        raise SweepError(
            "--shard: expected none, since each run depends on the ones before; for several computers give each one of "
            "--perturbations and a directory of its own, or use --scheduler (docs/cluster.md)"
        )
    options.check_drives()
    chosen, spec = options.chosen, options.specification(systems)
    announce_compilation()
    if plan:
        _print_plan(spec, chosen, out, execution)
        return 0
    directory, _ = prepare(out or default_directory("stress", datetime.now()), spec)
    test = StressTest(directory, chosen)
    with directory.locked(None):
        trials: list[Trial] = []
        try:
            progress = StressProgress(test.size, execution.worker_count)
            while trials := test.trials():
                left = [trial.cell for trial in trials if not test.is_done(trial)]
                progress.skip(len(trials) - len(left))
                if left:
                    check_code(directory)
                    execute(directory, left, execution.executor, progress)
                test.finish_turn(trials)
        except KeyboardInterrupt:
            with suppress(KeyboardInterrupt):
                console.print(
                    f"interrupted: {progress.left} runs are left; the same command with --out {directory.path} "
                    "continues with them",
                    soft_wrap=True,
                )
                results.print(f"report: {test.write(trials).resolve()}")
            return INTERRUPTED
        page = test.write()
    results.print((directory.path / "table.md").read_text(encoding="utf-8").rstrip(), markup=False)
    results.print(f"report: {page.resolve()}")
    return 0


class StressProgress:
    """Says how many runs are done and how long the others will take. Implements `testbed.sweep.execute.Watcher`."""

    def __init__(self, size: int, workers: int) -> None:
        self._size, self._workers = size, workers
        self._done = self._computed = 0
        self._seconds = 0.0
        self._said = time.monotonic()

    @property
    def left(self) -> int:
        """Number of runs that are left."""
        return self._size - self._done

    def skip(self, count: int) -> None:
        """Count runs that were done before."""
        self._done += count

    def event(self, event: Event) -> None:
        """A run was started, or is finished and on disk."""
        if not isinstance(event, Finished):
            return
        self._done += 1
        AT_WORK.now_doing(self._line)
        if isinstance(event.outcome, CellResult):
            self._computed += 1
            self._seconds += event.outcome.timing.get("cell_s") or 0.0
        else:
            console.print(f"no result: {event.cell}: {event.outcome}", soft_wrap=True, markup=False)
        if console.is_terminal or time.monotonic() - self._said > REPORT_EVERY:
            self._said = time.monotonic()
            console.print(self._line, soft_wrap=True, end="\r" if console.is_terminal else "\n")

    @property
    def _line(self) -> str:
        line = f"{self._done} of {self._size} runs"
        if not self._computed:
            return line
        seconds = self.left * self._seconds / self._computed / self._workers + REPORT_SECONDS
        return f"{line}, about {duration_words(seconds)} left"


def _print_plan(spec: SweepSpec, chosen: list[Perturbation], out: Path | None, execution: Execution) -> None:
    """Say how many runs there are, and how long those take that are left."""
    Costs.of(spec)  # complains of a world or system that is not there
    cells = cells_of(spec, code_version(), input_digests(spec))
    lines = list(dict.fromkeys(cell.line for cell in cells))
    turns = len(cells) // len(lines)
    each = turns * (1 + len(chosen))
    results.print(
        f"{each * len(lines)} runs: {turns} drives ({_places(spec)}, {len(spec.seeds)} seeds), "
        f"{len(lines)} systems, {len(chosen)} perturbations and none"
    )
    done = 0
    if out is not None and (out / MANIFEST).is_file():
        folder = SweepDirectory.open(out).path
        done = sum(1 for _ in (folder / "cells").iterdir()) + sum(1 for _ in (folder / "failed").iterdir())
        results.print(f"{done} of them are done")
    seconds = {}
    for line in lines:
        first = next(cell for cell in cells if cell.line == line)
        began = time.perf_counter()
        compute(first)
        seconds[line] = time.perf_counter() - began
        results.print(f"{line}: {seconds[line]:.1f} s a run, measured on {first.place}, seed {first.seed}")
    total = max(each * len(lines) - done, 0) * sum(seconds.values()) / len(lines) / execution.worker_count
    workers = execution.worker_count
    results.print(
        f"Expected: about {duration_words(total + REPORT_SECONDS)} with {workers} worker{'s' if workers > 1 else ''}"
    )


def _places(spec: SweepSpec) -> str:
    return f"{len(spec.logs)} logs" if spec.logs else f"{len(spec.worlds)} worlds"
