# SPDX-License-Identifier: MIT
"""What `testbed sweep` says before it starts: how much there is to compute, how long it takes, what it can tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from eval.sweep.margin import parse_margin
from eval.sweep.planning import foresight
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.sweep_options import Execution
from testbed.sweep.forecast import MIN_COST, expected_seconds, measure_pace
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.command import grouped
from testbed.sweep.spec.plan import Costs
from testbed.sweep.spec.spec import SweepSpec
from worlds import family


def announce(
    spec: SweepSpec, costs: Costs, cells: Sequence[Cell], execution: Execution, *, is_plan: bool = False
) -> None:
    """Say what is to be computed, how long it will take, and what it will be able to tell.

    cells: those that are left until the results are looked at. is_plan: they are only planned.
    """
    print_line = results.print if is_plan else console.print
    print_line(f"{_size(spec, len(cells), is_plan=is_plan)}: {_extent(spec)}", soft_wrap=True, markup=False)
    if cells:
        print_line(_time(spec, costs, cells, execution), soft_wrap=True, markup=False)
    for sentence in _foresight(spec):
        print_line(sentence, soft_wrap=True, markup=False)


def _size(spec: SweepSpec, left: int, *, is_plan: bool) -> str:
    if spec.until and not is_plan:
        return f"{left} jobs until the results are looked at, at most {spec.size} in all"
    return f"{left} jobs" if left == spec.size else f"{left} of {spec.size} jobs are left"


def _time(spec: SweepSpec, costs: Costs, cells: Sequence[Cell], execution: Execution) -> str:
    """How long these jobs will take, from a short measurement."""
    if execution.scheduler is not None:
        return "The cluster decides how long that takes."
    if sum(map(costs, cells)) < MIN_COST:
        return "That takes some seconds."
    announce_compilation()
    console.print("measuring the beginning of a run …")
    paces = measure_pace(cells, costs)
    if paces is None:
        return "Recorded logs are not measured beforehand; the time left is shown as soon as jobs are done."
    workers = execution.worker_count
    seconds = expected_seconds(cells, costs, paces, workers)
    most = "at most " if spec.until else ""
    return f"Expected: {most}about {_duration(seconds)} with {workers} worker{'s' if workers > 1 else ''}."


def _foresight(spec: SweepSpec) -> list[str]:
    """What the seeds, and the worlds of each kind of building, will be able to tell."""
    margin = parse_margin(spec.margin)
    kinds = Counter(kind for kind in map(family, spec.worlds) if kind is not None)
    sampled = {kind: number for kind, number in kinds.items() if number > 1}
    sentences = [
        f"{kind}: {foresight(number, 'world', level=spec.level, margin=margin)}" for kind, number in sampled.items()
    ]
    if len(spec.worlds) + len(spec.logs) > sum(sampled.values()):
        sentences.insert(0, foresight(len(spec.seeds), level=spec.level, margin=margin))
    return sentences


def _duration(seconds: float) -> str:
    for unit, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 1.7 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{max(seconds, 10.0):.0f} s"


def _routes(spec: SweepSpec) -> str:
    """How many routes the answer for a world will rest on; nothing for logs."""
    routes = {str(line.settings.get("route", "fixed")) for line in spec.lines()}
    if spec.logs or len(routes) > 1:
        return ""
    number = len(spec.seeds) if "fixed" not in routes else 1
    each = " in each world" if len(spec.worlds) > 1 else ""
    return f" ({'one route' if number == 1 else f'{number} routes'}{each})"


def _extent(spec: SweepSpec) -> str:
    places = [*grouped(spec.worlds), *(log.name for log in spec.logs)]
    names = [line.name for line in spec.lines()]
    lines = "" if names == ["default"] else f"; {', '.join(names)}"
    counts = ", ".join(map(str, spec.particles))
    bound = "up to " if spec.until else ""
    seeds = f"{bound}{len(spec.seeds)} seed{'' if len(spec.seeds) == 1 else 's'}"
    return (
        f"{', '.join(places)}; {seeds}{_routes(spec)}{lines}; {counts} particle{'' if spec.particles == (1,) else 's'}"
    )
