# SPDX-License-Identifier: MIT
"""`testbed sweep`."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from eval.sweep.measure import Measure
from eval.sweep.planning import foresight
from eval.sweep.regression_check import compare_with_baseline, write_baseline
from eval.sweep.results import read_sweep
from testbed.cli.gather import gather_and_report
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.output import FLAG
from testbed.cli.shared.status import GATE_FAILED, INTERRUPTED
from testbed.cli.shared.sweep_progress import sweep_progress
from testbed.run.run_directory import default_directory
from testbed.sweep.errors import SweepError
from testbed.sweep.execute import Executor, execute, pending, prepare
from testbed.sweep.execution.dask_cluster import run_on_cluster
from testbed.sweep.execution.local_pool import run_locally
from testbed.sweep.execution.worker_process import Limits
from testbed.sweep.forecast import MIN_COST, expected_seconds, measure_pace
from testbed.sweep.looks import needed_cells
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.command import grouped
from testbed.sweep.spec.plan import Costs, Shard
from testbed.sweep.spec.plan import plan as plan_cells
from testbed.sweep.spec.spec import BASELINE, SweepSpec, parse_spec, parsed_axes, read_document, read_preset
from testbed.sweep.store import SweepDirectory
from worlds import expand_names, family


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """What is to be computed: a preset or flags. Flags override a file and a preset."""

    preset: str | None = None
    """Specification in the package: particles, gate."""
    worlds: str | None = None
    """Worlds, separated by commas; generated:rooms*20 stands for 20 generated worlds."""
    particles: str | None = None
    """Particle counts, separated by commas."""
    seeds: str | None = None
    """Number of seeds, from 0 on; or a list such as 0,1,2 or a range such as 0:10."""
    route: Literal["fixed", "random"] | None = None
    """fixed: all seeds drive the tour of the world; random: each seed drives the whole tour in another order and
    direction from another start. Default: fixed."""
    measure: str | None = None
    """What accuracy is measured by: online (the pose reported at each scan), filter (the best particle's path at the
    end), refined (after the final pass), or any key of metrics.json of which less is better. Default: filter."""
    refine: Literal["ends", "all", "none"] | None = None
    """Which runs end with the final pass: those with the smallest and the largest count, all, or none. Default: ends;
    all where the measure needs it."""
    until: Literal["decided"] | None = None
    """decided: add seeds, 8 at a time, where the answer is open, up to --seeds (default: 40). Each look at the results
    uses higher confidence, so that all looks together keep 95 %."""
    axis: tuple[str, ...] = ()
    """NAME=VALUE,VALUE: a setting with several values; each is one line of the plots. May be repeated."""
    set: tuple[str, ...] = ()
    """NAME=VALUE: a setting of all runs. May be repeated."""

    def document(self) -> dict[str, Any]:
        """The given flags as the document of a specification."""
        flags: dict[str, Any] = {}
        if self.worlds is not None:
            flags["worlds"] = expand_names(self.worlds)
        if self.particles is not None:
            flags["particles"] = _counts(self.particles)
        if self.seeds is not None:
            flags["seeds"] = self.seeds
        if self.measure is not None:
            flags["measure"] = self.measure
        if self.until is not None:
            flags |= {"until": self.until, "seeds": self.seeds or MAX_SEEDS_UNTIL_DECIDED}
        if self.axis:
            flags["axes"] = parsed_axes(self.axis)
        return flags

    def specification(self, file: Path | None, out: Path | None) -> SweepSpec:
        """The specification of a file, a preset or flags; without any of them that of the sweep in `out`."""
        if file is not None and self.preset is not None:
            raise SweepError(f"{file} and --preset {self.preset}: expected one of the two")
        if file is not None:
            return self._with_flags(read_document(file), str(file), file.parent)
        if self.preset is not None:
            return self._with_flags(read_preset(self.preset), f"preset {self.preset}", Path())
        if self == SweepOptions() and out is not None:
            return SweepDirectory.open(out).manifest.spec
        return self._with_flags({}, "command line", Path())

    def _with_flags(self, document: dict[str, Any], source: str, folder: Path) -> SweepSpec:
        spec = parse_spec(document | self.document(), source, folder)
        settings = {name: values[0] for name, values in parsed_axes(self.set).items() if values}
        if self.route is not None:
            settings["route"] = self.route
        if self.refine in ("all", "none"):
            settings["refine"] = self.refine == "all"
        shared = {name: value for name, value in spec.settings.items() if name != "refine" or self.refine != "ends"}
        if shared | settings == spec.settings:
            return spec
        return parse_spec(spec.document() | {"settings": shared | settings}, source, folder)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Execution:
    """How the jobs are executed; the results do not depend on it."""

    workers: int | None = None
    """Worker processes. Default: one per core."""
    shard: str | None = None
    """i/n: compute only shard i of n (from 0); `testbed gather` combines the shards."""
    scheduler: str | None = None
    """Address of a dask.distributed scheduler, such as tcp://host:8786, whose workers compute the jobs."""
    time_limit: float = 3600.0
    """Time limit of one job [s]; a job that takes longer counts as failed."""
    memory_limit: float | None = None
    """Memory limit of one worker [MB]. Default: nine tenths of the memory, divided by the workers."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise SweepError(f"workers must be at least 1, got {self.workers}")
        _ = self.limits, self.part

    @property
    def limits(self) -> Limits:
        """Limits of one job."""
        return Limits(seconds=self.time_limit, megabytes=self.memory_limit)

    @property
    def part(self) -> Shard | None:
        """The requested shard; None for all jobs."""
        return None if self.shard is None else Shard.parse(self.shard)

    @property
    def worker_count(self) -> int:
        """Worker processes on this machine."""
        return self.workers or os.cpu_count() or 1

    @property
    def executor(self) -> Executor:
        """Computes the jobs as requested."""
        if self.scheduler is not None:
            return partial(run_on_cluster, address=self.scheduler, limits=self.limits)
        return partial(run_locally, workers=self.worker_count, limits=self.limits)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RegressionOptions:
    """Comparison with a baseline. Without another sweep the preset `gate` is run."""

    check: Annotated[bool, FLAG] = False
    """Exit with 1 if accuracy is worse than the baseline by more than the noise of the seeds."""
    update_baseline: Annotated[bool, FLAG] = False
    """Write a new baseline."""
    baseline: Path = BASELINE
    """File of the baseline. Default: that of the preset `gate`."""

    @property
    def is_requested(self) -> bool:
        """Whether a baseline is read or written."""
        return self.check or self.update_baseline


MAX_SEEDS_UNTIL_DECIDED = "40"
"""Upper bound of the seeds for `--until decided` without --seeds."""
REQUEST = SweepOptions()
REGRESSION = RegressionOptions()
EXECUTION = Execution()


def sweep(
    spec: Path | None = None,
    /,
    *,
    request: SweepOptions = REQUEST,
    out: Path | None = None,
    execution: Execution = EXECUTION,
    worst: bool = True,
    gate: RegressionOptions = REGRESSION,
    plan: Annotated[bool, FLAG] = False,
) -> int:
    """Measure accuracy against particle count over worlds or logs, seeds and variants, with confidence intervals.

    Parameters
    ----------
    spec
        TOML file with the specification (docs/sweep.md).
    out
        Directory of the sweep; an unfinished sweep in it is completed. Default: a new one in runs/.
    worst
        At the end repeat the worst runs that failed, or were three times worse than usual, with a recording and a
        report each.
    plan
        Print what would be computed, how long it would take and what it could tell, and stop.
    """
    if spec is None and request == REQUEST and gate.is_requested:
        request = SweepOptions(preset="gate")
    specification = request.specification(spec, out)
    part = execution.part
    if part is not None and specification.until:
        raise SweepError("--shard and --until: expected one of them, since a shard does not know the results of others")
    if plan:
        _announce(specification, Costs.of(specification), None, execution)
        return 0
    directory, costs = prepare(out or default_directory("sweep", datetime.now()), specification)
    with directory.locked(part):
        if execution.scheduler is None:
            announce_compilation()
        cells = pending(directory, needed_cells(directory), costs, part)
        _announce(specification, costs, cells, execution)
        try:
            while cells:
                with sweep_progress(cells, costs, Measure(specification.key_measure), worst=worst) as progress:
                    execute(directory, cells, execution.executor, progress)
                tried = {cell.key for cell in cells}
                more = pending(directory, needed_cells(directory), costs, part)
                cells = [cell for cell in more if cell.key not in tried] if specification.until else []
                if cells:
                    console.print(f"looked at the results: {len(cells)} more jobs where the answer is open")
        except KeyboardInterrupt:
            return _interrupted(directory, costs, part)
    if part is not None:
        failed = sum(directory.reason(cell.key) is not None for cell in cells)
        results.print(
            f"{directory.path}: shard {part} is done, {failed} jobs failed; after the last shard run: testbed gather"
        )
        return GATE_FAILED if failed else 0
    status = gather_and_report(directory, worst=worst)
    if gate.update_baseline:
        write_baseline(read_sweep(directory.path), gate.baseline)
        results.print(f"baseline: {gate.baseline}")
    return max(status, _compare(directory.path, gate.baseline)) if gate.check else status


def _interrupted(directory: SweepDirectory, costs: Costs, part: Shard | None) -> int:
    """Leave a report of what there is, and say how to go on."""
    with suppress(KeyboardInterrupt):
        left = len(pending(directory, needed_cells(directory), costs, part))
        console.print(
            f"interrupted: {left} jobs are left; testbed sweep --out {directory.path} continues with them",
            soft_wrap=True,
        )
        if part is None:
            gather_and_report(directory, worst=False)
    return INTERRUPTED


def _announce(spec: SweepSpec, costs: Costs, cells: Sequence[Cell] | None, execution: Execution) -> None:
    """Say what is to be computed, how long it will take, and what it will be able to tell.

    cells: those that are left; None = all, which are only planned.
    """
    is_plan = cells is None
    cells = plan_cells(spec, code_version(), {}) if cells is None else cells
    jobs = f"{len(cells)} jobs" if is_plan or len(cells) == spec.size else f"{len(cells)} of {spec.size} jobs"
    workers = execution.worker_count
    if is_plan:
        announce_compilation()
    pace = measure_pace(cells, costs) if execution.scheduler is None else None
    if pace is None:
        took = "" if sum(map(costs, cells)) >= MIN_COST else ", some seconds"
    else:
        seconds = expected_seconds(cells, costs, pace, workers)
        most = "at most " if spec.until else ""
        took = f", {most}about {_duration(seconds)} with {workers} worker{'s' if workers > 1 else ''}"
    print_line = results.print if is_plan else console.print
    print_line(f"{jobs}: {_extent(spec)}{took}", soft_wrap=True, markup=False)
    for sentence in _foresight(spec):
        print_line(sentence, soft_wrap=True, markup=False)


def _foresight(spec: SweepSpec) -> list[str]:
    """What the seeds, and the worlds of each kind of building, will be able to tell."""
    kinds = Counter(kind for kind in map(family, spec.worlds) if kind is not None)
    sampled = {kind: number for kind, number in kinds.items() if number > 1}
    sentences = [f"{kind}: {foresight(number, 'world', level=spec.level)}" for kind, number in sampled.items()]
    if len(spec.worlds) + len(spec.logs) > sum(sampled.values()):
        sentences.insert(0, foresight(len(spec.seeds), level=spec.level))
    return sentences


def _duration(seconds: float) -> str:
    return f"{max(seconds, 10.0):.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} minutes"


def _compare(directory: Path, baseline: Path) -> int:
    """Print how accuracy compares with the baseline; returns the exit status."""
    comparisons = compare_with_baseline(read_sweep(directory), baseline)
    for c in comparisons:
        word = "worse" if c.worse else "better: renew the baseline" if c.better else "as before"
        results.print(f"{c.name}: {c.factor:.2f} times the baseline's error, up to {c.allowed:.2f} is noise: {word}")
    return GATE_FAILED if any(c.worse for c in comparisons) else 0


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _counts(text: str) -> list[int]:
    words = _words(text)
    if not all(word.isdecimal() for word in words):
        raise SweepError(f"--particles {text}: expected whole numbers such as 1,5,30")
    return list(map(int, words))


def _extent(spec: SweepSpec) -> str:
    places = [*grouped(spec.worlds), *(log.name for log in spec.logs)]
    lines = ", ".join(line.name for line in spec.lines())
    counts = ", ".join(map(str, spec.particles))
    bound = "up to " if spec.until else ""
    return f"{', '.join(places)}; {bound}{len(spec.seeds)} seeds; {lines}; {counts} particles"
