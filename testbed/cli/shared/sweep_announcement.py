# SPDX-License-Identifier: MIT
"""What `testbed sweep` says before it starts: how much there is to compute, how long it takes, what it can tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eval.sweep.advice import chances
from eval.sweep.answers import answers
from eval.sweep.job_times import duration_words
from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, fewest_seeds_to_go_on
from eval.sweep.margin import parse_margin, share_words
from eval.sweep.measure import Measure
from eval.sweep.outlook import TYPICAL_ERROR
from eval.sweep.planning import foresight
from eval.sweep.remarks import margin_words
from eval.sweep.results import SweepTable, SweepTableError, read_sweep
from eval.sweep.statistics import min_values
from eval.sweep.summary import summarise
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.sweep_looks import MAX_PLACES
from testbed.cli.shared.sweep_options import Execution
from testbed.cli.shared.sweep_progress import SIZE_SEEDS
from testbed.kernels import is_compiled
from testbed.sweep.forecast import MIN_COST, JobTimes, measured_times, probed_times
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.command import grouped
from testbed.sweep.spec.plan import Costs
from testbed.sweep.spec.spec import SweepSpec
from worlds import family

USUAL_MEASURE = "trajectory_filter.ate_rmse_m"
"""The measure whose usual size is known before anything is computed."""


@dataclass(frozen=True)
class Work:
    """What a sweep has to compute."""

    spec: SweepSpec
    costs: Costs
    cells: Sequence[Cell]
    """The jobs that are left up to the next look at the results, or to the end."""
    all_cells: Sequence[Cell]
    """All jobs that are left, if no answer is found before."""
    next_look: int
    """Seeds at the next look; without `until`, all seeds."""
    done: SweepTable | None
    """The tables of the jobs that are done."""
    finished: int
    """Number of jobs that are done."""


def done_so_far(out: Path | None, spec: SweepSpec) -> SweepTable | None:
    """The results in the directory of a sweep, as `spec` asks for them; None where there are none."""
    if out is None:
        return None
    try:
        table = read_sweep(out)
    except SweepTableError:
        return None
    baseline = spec.baseline or spec.lines()[0].name
    if not table.ran.any() or baseline not in table.lines:
        return None
    table = replace(
        table,
        until=spec.until,
        level=spec.level,
        margin=parse_margin(spec.margin),
        measure=Measure(spec.key_measure),
        baseline=baseline,
    )
    return table.with_final_pass() if table.measure.needs_final_pass else table


def announce(work: Work, execution: Execution, *, is_plan: bool = False) -> JobTimes | None:
    """Say what is to be computed, how long it will take, and what it will be able to tell.

    is_plan: the jobs are only planned. Returns the expected times of the jobs; None if they are unknown.
    """
    print_line = results.print if is_plan else console.print

    def say(text: str) -> None:
        print_line(text, soft_wrap=True, markup=False)

    say(f"{_size(work)}: {_extent(work.spec)}")
    if not work.spec.names_systems:  # with systems the question is not how many particles are enough
        say(_margin(work))
        for line in _answers_so_far(work) or _foresight(work):
            say(line)
    times = _times(work, execution, is_plan=is_plan) if work.cells else None  # last: it may take minutes, to compile
    if work.cells:
        say(f"Time: {_expected(work, times, execution)}")
    return times


def _size(work: Work) -> str:
    total, left = work.spec.size, len(work.all_cells)
    needless = total - left - work.finished if work.spec.until else 0  # else jobs that are missing are other shards'
    reason = f", {needless} are not needed: their world has an answer, hardly a chance of one, or was given up"
    words = f"{work.finished} of {total} are done{reason if needless else ''}"
    done = f" ({words})" if work.finished else ""
    if work.spec.until and len(work.cells) < left:
        which = "the next" if done else "the first"
        return f"{len(work.cells)} jobs to {which} look ({work.next_look} seeds a world), at most {left} in all{done}"
    return f"{left} job{'' if left == 1 else 's'}{done}"


def _times(work: Work, execution: Execution, *, is_plan: bool) -> JobTimes | None:
    """Expected times of the jobs: from those that are done, else from a short measurement, which needs the kernels."""
    if work.done is not None:
        times = measured_times(work.done, work.all_cells, work.costs)
        if times is not None:
            return times
    if execution.scheduler is not None or sum(map(work.costs, work.cells)) < MIN_COST:
        return None
    if is_plan and not is_compiled():
        console.print(
            "The rest is the time that it takes. Measuring it needs the kernels, which are compiled first; Ctrl-C ends "
            "here, nothing is lost.",
            soft_wrap=True,
        )
    announce_compilation()
    if any("world" in cell.source for cell in work.cells):
        console.print("measuring the beginning of a run (half a minute or less) …")
    return probed_times(work.cells, work.costs, min(execution.worker_count, len(work.cells)))


def _expected(work: Work, times: JobTimes | None, execution: Execution) -> str:
    """How long these jobs will take, in lines below `Time:`."""
    if execution.scheduler is not None:
        return "as the cluster decides."
    if times is None and sum(map(work.costs, work.cells)) < MIN_COST:
        return "some seconds."
    if times is None:
        return "unknown, since recorded logs are not measured beforehand; it is shown as soon as a job is done."
    workers = execution.worker_count
    first, most = (duration_words(times.total(cells, workers)) for cells in (work.cells, work.all_cells))
    by = f"with {workers} worker{'s' if workers > 1 else ''}, {times.source}, if the machine stays as busy as it is"
    if not work.spec.until or len(work.cells) == len(work.all_cells):
        said = f"about {first} {by}."
        return "\n  ".join(
            filter(None, [said, _by_place(work, times, workers), _time_of_more_seeds(work, times, workers)])
        )
    looks = sum(look > work.next_look for look in work.spec.looks)
    further = f"{looks} more look{'s' if looks > 1 else ''}"
    said = f"about {first} to that look {by}."
    return "\n  ".join(
        filter(None, [said, f"With up to {further} at most about {most} in all.", _by_place(work, times, workers)])
    )


def _by_place(work: Work, times: JobTimes, workers: int) -> str:
    """How long each of a few worlds or logs takes: `By world: loop about 18 minutes, apartment about 11 minutes.`, or
    `By world: loop about 3 minutes to that look, 18 minutes at most, …`"""
    places = list(dict.fromkeys(cell.place for cell in work.all_cells))
    if not 1 < len(places) <= MAX_PLACES:
        return ""

    def of(cells: Sequence[Cell], place: str) -> str:
        return duration_words(times.total([cell for cell in cells if cell.place == place], workers))

    words = [f"{place} about {of(work.all_cells, place)}" for place in places]
    if len(work.cells) < len(work.all_cells):  # there is a look before the end
        words = [
            f"{place} about {of(work.cells, place)} to that look, {of(work.all_cells, place)} at most"
            for place in places
        ]
    return f"By world: {', '.join(words)}."


def _margin(work: Work) -> str:
    """How large a difference is taken for none: it decides what the sweep can show, and is chosen beforehand."""
    said = "Margin: an error that is larger by up to {} counts as equal."
    if work.done is not None and work.done.ran.all(axis=2).any():
        return said.format(margin_words(summarise(work.done.judged())))
    margin, key = parse_margin(work.spec.margin), work.spec.key_measure
    usual = ""
    if key == USUAL_MEASURE:
        share = share_words(margin.of(TYPICAL_ERROR), TYPICAL_ERROR)
        size = f"about {100.0 * TYPICAL_ERROR:.1f} cm; after {SIZE_SEEDS} seeds it is said of your worlds"
        usual = f" That is {share} of a usual error, {size}."
    words = margin.words(is_length=key.endswith("_m"))
    return f"{said.format(words)}{usual}\n  Choose it before you see results: --margin 2mm, 5% or 5%,2mm."


def _answers_so_far(work: Work) -> list[str]:
    """The answers that an existing sweep has given, and how many seeds its open ones would take."""
    if work.done is None or not work.done.ran.all(axis=2).any():  # no seed has all of its counts
        return []
    summary = summarise(work.done.judged())
    known = answers(summary, work.done.baseline)
    if len(work.spec.seeds) > len(work.done.seeds):  # what they needed was said of a smaller bound
        known = [replace(answer, needs="") for answer in known]
    found = [line for answer in known for line in answer.lines]
    said = ["So far:", *(f"  {line}" for line in found)]
    return [*said, *filter(None, [chances(summary, len(work.spec.seeds))])]


def _foresight(work: Work) -> list[str]:
    """What the seeds, and the worlds of each kind of building, will be able to tell."""
    spec = work.spec
    margin = parse_margin(spec.margin)
    kinds = Counter(kind for kind in map(family, spec.worlds) if kind is not None)
    sampled = {kind: number for kind, number in kinds.items() if number > 1}
    lines = []
    if len(spec.worlds) + len(spec.logs) > sum(sampled.values()):
        lines += foresight(len(spec.seeds), level=spec.level, margin=margin)
        if not spec.until and spec.drawn_seeds is None and len(spec.seeds) >= min_values(spec.level):
            lines.append("--until decided looks at the results in between and stops where the answer is known.")
    for number in dict.fromkeys(sampled.values()):
        first, *others = foresight(number, "world", level=spec.level, margin=margin)
        lines += [f"{', '.join(kind for kind, own in sampled.items() if own == number)}: {first}", *others]
    return [f"Can tell: {lines[0]}", *(f"  {line}" for line in lines[1:])]


def _time_of_more_seeds(work: Work, times: JobTimes, workers: int) -> str:
    """How long the fewest seeds that can tell take, and the most, where these are fewer."""
    spec = work.spec
    if spec.names_systems or len(spec.seeds) >= min_values(spec.level) or len(work.all_cells) < spec.size:
        return ""
    whole, fewest = times.total(work.all_cells, workers), fewest_seeds_to_go_on(spec.level)
    few, most = (duration_words(whole * n / len(spec.seeds)) for n in (fewest, MAX_SEEDS_UNTIL_DECIDED))
    return f"{fewest} seeds take about {few}, {MAX_SEEDS_UNTIL_DECIDED} about {most}."


def _routes(spec: SweepSpec) -> str:
    """How many routes the answer for a world will rest on; nothing for logs."""
    routes = {str(line.settings.get("route", "fixed")) for line in spec.lines()}
    if spec.logs or len(routes) > 1:
        return ""
    number = len(spec.seeds) if "fixed" not in routes else 1
    each = " in each world" if len(spec.worlds) > 1 else ""
    durations = {line.settings.get("duration") for line in spec.lines()}
    cut = f"the first {durations.pop():g} s of " if len(durations) == 1 and None not in durations else ""
    return f" ({cut}{'one route' if number == 1 else f'{number} routes'}{each})"


def _extent(spec: SweepSpec) -> str:
    places = [*grouped(spec.worlds), *(log.name for log in spec.logs)]
    names = [line.name for line in spec.lines()]
    lines = "" if names == ["default"] else f"; {', '.join(names)}"
    counts = ", ".join(map(str, spec.particles))
    bound = "up to " if spec.until else ""
    seeds = f"{bound}{len(spec.seeds)} seed{'' if len(spec.seeds) == 1 else 's'}"
    drawn = f", {spec.drawn_seeds} of each drawn world" if spec.drawn_seeds is not None and spec.drawn_worlds else ""
    particles = f"{counts} particle{'' if spec.particles == (1,) else 's'}"
    return f"{', '.join(places)}; {seeds}{_routes(spec)}{drawn}{lines}; {particles}"
