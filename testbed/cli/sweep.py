# SPDX-License-Identifier: MIT
"""`testbed sweep`."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Annotated

from eval.sweep.measure import Measure
from eval.sweep.regression_check import compare_with_baseline, write_baseline
from eval.sweep.results import read_sweep
from testbed.cli.gather import gather_and_report
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.output import FLAG
from testbed.cli.shared.status import GATE_FAILED, INTERRUPTED
from testbed.cli.shared.sweep_announcement import announce
from testbed.cli.shared.sweep_options import EXECUTION, REGRESSION, REQUEST, Execution, RegressionOptions, SweepOptions
from testbed.cli.shared.sweep_progress import sweep_progress
from testbed.cli.shared.sweep_suggestion import print_suggestion
from testbed.run.run_directory import default_directory
from testbed.sweep.errors import SweepError
from testbed.sweep.execute import execute, pending, prepare, unfinished
from testbed.sweep.looks import needed_cells
from testbed.sweep.spec.plan import Costs, Shard
from testbed.sweep.store import SweepDirectory


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
    suggest: str | None = None,
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
    suggest
        World or log: print how many particles to take for it and why, from the experiment of docs/study.md, and stop.
        --set NAME=VALUE and --route describe robot, lidar, odometry and route of a world.
    """
    if suggest is not None:
        if spec is not None or replace(request, set=(), route=None) != REQUEST:
            raise SweepError(f"--suggest {suggest}: takes --set and --route only")
        return print_suggestion(suggest, request.own_settings())
    if spec is None and request == REQUEST and gate.is_requested:
        request = SweepOptions(preset="gate")
    specification = request.specification(spec, out)
    part = execution.part
    if part is not None and specification.until:
        raise SweepError("--shard and --until: expected one of them, since a shard does not know the results of others")
    if plan:
        announce(specification, Costs.of(specification), unfinished(out, specification), execution, is_plan=True)
        return 0
    directory, costs = prepare(out or default_directory("sweep", datetime.now()), specification)
    with directory.locked(part):
        if execution.scheduler is None:
            announce_compilation()
        cells = pending(directory, needed_cells(directory), costs, part)
        announce(specification, costs, cells, execution)
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
            gather_and_report(directory, worst=False, lists_missing=False)
    return INTERRUPTED


def _compare(directory: Path, baseline: Path) -> int:
    """Print how accuracy compares with the baseline; returns the exit status."""
    comparisons = compare_with_baseline(read_sweep(directory), baseline)
    for c in comparisons:
        word = "worse" if c.worse else "better: renew the baseline" if c.better else "as before"
        results.print(f"{c.name}: {c.factor:.2f} times the baseline's error, up to {c.allowed:.2f} is noise: {word}")
    return GATE_FAILED if any(c.worse for c in comparisons) else 0
