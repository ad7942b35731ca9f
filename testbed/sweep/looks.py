# SPDX-License-Identifier: MIT
"""Adding seeds until the answer is known: which cells are needed after each look at the results.

With `until = "decided"` the seeds of a sweep are an upper bound. Its results are looked at after 8, 16, 24, … seeds,
and a world (or kind of building) and line that is decided gets no more. Looking J times would give J chances to be
wrong, so each look uses intervals of the level 1 - 0.05 / J: the error probability is spent evenly over the looks, and
by the union bound all looks together are wrong in at most 5 % of cases, however they depend on each other.
Source: Lan, DeMets, "Discrete sequential boundaries for clinical trials", Biometrika 70(3), 1983 (linear spending);
Bonferroni's bound replaces the joint distribution, which is unknown for bootstrapped medians, and is conservative.
"""

from __future__ import annotations

from dataclasses import replace

from eval.sweep.results import SweepTable, read_sweep
from eval.sweep.summary import SweepSummary
from testbed.sweep.gather import gather
from testbed.sweep.spec.cell import Cell
from testbed.sweep.store import SweepDirectory


def needed_cells(directory: SweepDirectory) -> list[Cell]:
    """The cells that are needed up to the next look, in the order of the tables; all of them without `until`.

    It follows from the stored results alone, so that a sweep which was interrupted goes on with the same cells.
    """
    return _look(directory)[0]


def statuses(directory: SweepDirectory) -> dict[str, str]:
    """Status of each cell that was not computed, by its key, for `testbed.sweep.gather`.

    missing: it is needed; later: it may be, after the next look; not needed: the answer is known without it
    """
    needed, still_open = _look(directory)
    keys = {cell.key for cell in needed}
    later = {True: "later", False: "not needed"}
    return {
        cell.key: "missing" if cell.key in keys else later[(cell.place, cell.line) in still_open]
        for cell in directory.manifest.cells()
    }


def _look(directory: SweepDirectory) -> tuple[list[Cell], set[tuple[str, str]]]:
    """The needed cells, and the worlds and lines whose answer was open at the last complete look."""
    cells = directory.manifest.cells()
    spec = directory.manifest.spec
    if not spec.until:
        return cells, set()
    gather(directory)
    table = read_sweep(directory.path)
    needed: list[Cell] = []
    still_open = {(place, line) for place in table.places for line in table.lines}
    previous = 0
    for look in spec.looks:
        seeds = spec.seeds[previous:look]
        added = [cell for cell in cells if cell.seed in seeds and (cell.place, cell.line) in still_open]
        needed += added
        if not all(directory.is_done(cell.key) or directory.reason(cell.key) is not None for cell in added):
            break
        still_open = undecided(_first_seeds(table, look), still_open)
        previous = look
    keys = {cell.key for cell in needed}
    return [cell for cell in cells if cell.key in keys], still_open


def undecided(table: SweepTable, candidates: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Those of the candidates, worlds and lines, that have no answer yet; a kind of building is one answer."""
    summary = SweepSummary(table, ())
    families = table.family_names()
    found = set()
    for place, line in candidates:
        family = table.families[table.places.index(place)]
        is_family = family is not None and family in families
        decision = summary.decision_of_family(str(family), line) if is_family else summary.decision(place, line)
        if decision.kind == "undecided":
            found.add((place, line))
    return found


def _first_seeds(table: SweepTable, count: int) -> SweepTable:
    """The table without the seeds after the first `count` ones."""
    columns = {name: cube[..., :count] for name, cube in table.columns.items()}
    curves = {name: cube[..., :count, :] for name, cube in table.curves.items()}
    return replace(table, seeds=table.seeds[:count], columns=columns, curves=curves)
