# SPDX-License-Identifier: MIT
"""What `testbed sweep` says before it starts: how much there is to compute, how long it takes, what it can tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from eval.sweep.planning import foresight
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.sweep_options import Execution
from testbed.sweep.forecast import MIN_COST, expected_seconds, measure_pace
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.command import grouped
from testbed.sweep.spec.plan import Costs
from testbed.sweep.spec.plan import plan as plan_cells
from testbed.sweep.spec.spec import SweepSpec
from worlds import family


def announce(spec: SweepSpec, costs: Costs, cells: Sequence[Cell] | None, execution: Execution) -> None:
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
    for unit, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 1.7 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{max(seconds, 10.0):.0f} s"


def _extent(spec: SweepSpec) -> str:
    places = [*grouped(spec.worlds), *(log.name for log in spec.logs)]
    lines = ", ".join(line.name for line in spec.lines())
    counts = ", ".join(map(str, spec.particles))
    bound = "up to " if spec.until else ""
    return f"{', '.join(places)}; {bound}{len(spec.seeds)} seeds; {lines}; {counts} particles"
