# SPDX-License-Identifier: MIT
"""A sweep from its plan to results on disk, whoever computes the cells."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Protocol

from testbed.sweep.execution.local_pool import Event, Finished
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import Costs, Shard, by_work, input_digests
from testbed.sweep.spec.spec import SweepSpec
from testbed.sweep.store import Manifest, SweepDirectory

Executor = Callable[[Sequence[Cell]], Generator[Event, None, None]]
"""Computes cells, those in front first, and tells of each: `run_locally` or `run_on_cluster` with their settings."""


class Watcher(Protocol):
    """Who is told how the sweep goes."""

    def event(self, event: Event) -> None:
        """A cell has been begun, or is done and on disk."""
        ...


def prepare(out: Path, spec: SweepSpec) -> tuple[SweepDirectory, Costs]:
    """The directory of a sweep, made or found, and what its cells cost.

    Raises SweepError, WorldError, PresetError, LogError or OSError for what cannot be used; nothing is written then.
    """
    costs = Costs.of(spec)
    return SweepDirectory.prepare(out, Manifest(spec, code_version(), input_digests(spec))), costs


def pending(directory: SweepDirectory, costs: Costs, shard: Shard | None) -> list[Cell]:
    """Cells that are still to be computed, the longest first; those that failed before are tried again."""
    cells = by_work(directory.manifest.cells(), costs)
    if shard is not None:
        cells = shard.of(cells)
    return [cell for cell in cells if not directory.is_done(cell.key)]


def execute(directory: SweepDirectory, cells: Sequence[Cell], executor: Executor, watcher: Watcher) -> None:
    """Compute cells and keep what comes of them."""
    with closing(executor(cells)) as events:  # workers end as soon as nobody waits for them
        for event in events:
            if isinstance(event, Finished):
                if isinstance(event.outcome, str):
                    directory.keep_failure(event.cell, event.outcome)
                else:
                    directory.keep(event.cell, event.outcome)
            watcher.event(event)
