# SPDX-License-Identifier: MIT
"""Adding seeds until the answer is known: which cells are needed after each look at the results.

With `until = "decided"` the seeds of a sweep are an upper bound. Its results are looked at after 8, 16, 24, … seeds,
and a world (or kind of building) and line that is decided gets no more; with `until = "smallest"` it gets more also
where a count is enough and a smaller one may be. Looking J times would give J chances to be
wrong, so each look uses intervals of the level 1 - 0.05 / J: the error probability is spent evenly over the looks, and
by the union bound all looks together are wrong in at most 5 % of cases, however they depend on each other.
Source: Lan, DeMets, "Discrete sequential boundaries for clinical trials", Biometrika 70(3), 1983 (linear spending);
Bonferroni's bound replaces the joint distribution, which is unknown for bootstrapped medians, and is conservative.

A world that all seeds up to the usual limit would decide with a chance below `MIN_CHANCE` gets no more either. That
adds no wrong answers: stopping can only take away answers (non-binding futility; Spiegelhalter, Freedman, Blackburn
1986).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from eval.sweep.decision import Decision
from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, MIN_CHANCE
from eval.sweep.results import GIVEN_UP, SweepTable
from eval.sweep.summary import SweepSummary
from testbed.sweep.gather import collect
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version, commit
from testbed.sweep.spec.plan import input_digests
from testbed.sweep.spec.spec import SweepSpec
from testbed.sweep.store import MANIFEST, Manifest, SweepDirectory, check_extends

Group = tuple[str, str]
"""A world and a line."""
Finished = Callable[[Cell], bool]
"""Whether a cell was computed, with or without a result."""


@dataclass(frozen=True)
class Look:
    """Where a sweep stands after its last complete look; without `until` all cells are needed."""

    needed: tuple[Cell, ...]
    """The cells up to the next look, in the order of the tables."""
    possible: tuple[Cell, ...]
    """All cells that are needed if no further look finds an answer."""
    still_open: frozenset[Group]
    """Worlds and lines whose answer is open and can still be found."""
    given_up: frozenset[Group]
    """Worlds and lines whose answer is open and would hardly be found."""
    seeds: int
    """Seeds at the next look of the world that has the fewest; after the last one, all seeds."""


def needed_cells(directory: SweepDirectory) -> list[Cell]:
    """The cells that are needed up to the next look, in the order of the tables; all of them without `until`.

    It follows from the stored results alone, so that a sweep which was interrupted goes on with the same cells.
    """
    return list(look_at(directory).needed)


def statuses(directory: SweepDirectory) -> dict[str, str]:
    """Status of each cell that was not computed, by its key, for `testbed.sweep.gather`.

    missing: it is needed; later: it may be, after the next look; not needed: the answer is known without it; given up:
    the answer is open, and would hardly be found with it
    """
    return _statuses(directory, look_at(directory))


def _statuses(directory: SweepDirectory, look: Look) -> dict[str, str]:
    keys = {cell.key for cell in look.needed}
    return {cell.key: "missing" if cell.key in keys else _status(cell, look) for cell in directory.cells()}


def _status(cell: Cell, look: Look) -> str:
    group = _group(cell)
    return "later" if group in look.still_open else GIVEN_UP if group in look.given_up else "not needed"


def look_at(directory: SweepDirectory) -> Look:
    """Look at the stored results; writes the tables of a sweep with `until`."""
    spec = directory.manifest.spec
    if not spec.until:
        cells = tuple(directory.cells())
        return Look(cells, cells, frozenset(), frozenset(), len(spec.seeds))
    collected = collect(directory)
    look = look_of(spec, collected.cells, collected.table(), partial(_is_finished, directory))
    collected.write(_statuses(directory, look))
    return look


def _is_finished(directory: SweepDirectory, cell: Cell) -> bool:
    """Whether a cell was computed, with or without a result."""
    return directory.is_done(cell.key) or directory.reason(cell.key) is not None


def look_of(spec: SweepSpec, cells: Sequence[Cell], table: SweepTable | None, is_finished: Finished) -> Look:
    """Where a sweep with `until` stands; each world and line goes from look to look on its own.

    table: the results, with level, margin and measure of `spec`; None if there are none. is_finished: whether a cell
    has a result or a reason.
    """
    keys: set[str] = set()
    groups = frozenset((cell.place, cell.line) for cell in cells)
    given_up = frozenset(group for group in groups if group[0] in spec.give_up)
    moving, waiting = groups - given_up, frozenset[Group]()
    previous = next_look = 0
    for look in spec.looks:
        added = _cells_of(cells, moving, spec.seeds[previous:look])
        keys |= {cell.key for own in added.values() for cell in own}
        whole = _whole(table, added, is_finished)
        found = undecided(_first_seeds(table, look), whole, spec.until) if table is not None and whole else {}
        hopeless = {
            group
            for group, decision in found.items()
            if table is not None and not _is_sample(table, group[0]) and is_hopeless(decision, len(spec.seeds))
        }
        if moving - whole:
            next_look = next_look or look
        waiting |= moving - whole
        given_up |= hopeless
        moving = frozenset(found) - hopeless
        previous = look
    still_open = waiting | moving
    return Look(
        needed=tuple(cell for cell in cells if cell.key in keys),
        possible=tuple(cell for cell in cells if cell.key in keys or _group(cell) in still_open),
        still_open=still_open,
        given_up=given_up,
        seeds=next_look or spec.looks[-1],
    )


def _cells_of(cells: Sequence[Cell], groups: frozenset[Group], seeds: Sequence[int]) -> dict[Group, list[Cell]]:
    """The cells of these groups that have one of these seeds, by group; of a group without any an empty list."""
    found: dict[Group, list[Cell]] = {group: [] for group in groups}
    wanted = set(seeds)
    for cell in cells:
        if cell.seed in wanted and (own := found.get(_group(cell))) is not None:
            own.append(cell)
    return found


def _group(cell: Cell) -> Group:
    return cell.place, cell.line


def _whole(table: SweepTable | None, added: Mapping[Group, Sequence[Cell]], is_finished: Finished) -> frozenset[Group]:
    """The groups whose further cells are all computed; of a kind of building, which has one answer, all or none."""
    if table is None:
        return frozenset()
    missing = {group for group, own in added.items() if not all(map(is_finished, own))}
    kinds = {(_kind(table, place), line) for place, line in missing} - {(None, line) for _, line in missing}
    return frozenset(group for group in added.keys() - missing if (_kind(table, group[0]), group[1]) not in kinds)


@dataclass(frozen=True)
class Planned:
    """What a specification would compute, with what a directory holds already."""

    needed: list[Cell]
    """The cells up to the next look at the results, or to the end."""
    possible: list[Cell]
    """All cells that are needed if no look finds an answer before."""
    next_look: int
    """Seeds at that look."""
    finished: int = 0
    """Number of cells that the directory holds already."""


def planned(out: Path | None, spec: SweepSpec, table: SweepTable | None) -> Planned:
    """The cells of a specification that a directory does not hold yet; all of them if there is no sweep in it.

    table: the results that are there, with level, margin and measure of `spec`. Raises SweepError if the directory
    holds another sweep. Nothing is written.
    """
    manifest = Manifest(spec, code_version(), input_digests(spec), commit())
    if out is None or not (out / MANIFEST).is_file():
        look = look_of(spec, manifest.cells(), None, lambda _: False)
        return Planned(list(look.needed), list(look.possible), look.seeds)
    directory = SweepDirectory.open(out)
    check_extends(out, directory.manifest, manifest)
    cells = SweepDirectory(out, manifest).cells()

    def left(some: Iterable[Cell]) -> list[Cell]:
        return [cell for cell in some if not directory.is_done(cell.key)]

    finished = len(cells) - len(left(cells))
    if not spec.until:
        return Planned(left(cells), left(cells), len(spec.seeds), finished)
    look = look_of(spec, cells, table, partial(_is_finished, directory))
    return Planned(left(look.needed), left(look.possible), look.seeds, finished)


def is_hopeless(decision: Decision, limit: int) -> bool:
    """Whether an open answer would be decided with a chance below `MIN_CHANCE`.

    By as many seeds as the limit allows, or the usual one where that is higher: a lower limit is a matter of time, and
    may be raised.
    """
    return decision.outlook is not None and decision.outlook.chance(max(limit, MAX_SEEDS_UNTIL_DECIDED)) < MIN_CHANCE


def undecided(table: SweepTable, candidates: frozenset[Group], until: str) -> Mapping[Group, Decision]:
    """Those of the candidates, worlds and lines, that have no answer yet; a kind of building is one answer.

    until: with "smallest" also those where a count is enough and a smaller one may be.
    """
    summary = SweepSummary(table, ())
    found = {}
    for place, line in sorted(candidates):
        kind = _kind(table, place)
        decision = summary.decision(place, line) if kind is None else summary.decision_of_family(kind, line)
        if decision.kind == "undecided" or (until == "smallest" and decision.may_be_smaller):
            found[place, line] = decision
    return found


def _is_sample(table: SweepTable, place: str) -> bool:
    """Whether a world is one of several of its kind, so that the unit of the answer is the world, not the seed."""
    return _kind(table, place) is not None


def _kind(table: SweepTable, place: str) -> str | None:
    """The kind of building that a world is one of several of; None for others."""
    family = table.families[table.places.index(place)]
    return family if family in table.family_names() else None


def _first_seeds(table: SweepTable, count: int) -> SweepTable:
    """The table without the seeds after the first `count` ones."""
    columns = {name: cube[..., :count] for name, cube in table.columns.items()}
    curves = {name: cube[..., :count, :] for name, cube in table.curves.items()}
    return replace(table, seeds=table.seeds[:count], columns=columns, curves=curves)
