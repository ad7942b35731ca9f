# SPDX-License-Identifier: MIT
"""Computes the cells of a sweep with any executor and writes each result to disk as it arrives."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Protocol

from testbed.sweep.errors import SweepError
from testbed.sweep.execution.local_pool import Event, Finished
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.code_version import code_version, commit, current_code_version
from testbed.sweep.spec.plan import Costs, Shard, input_digests, seed_by_seed
from testbed.sweep.spec.spec import SweepSpec
from testbed.sweep.store import Manifest, SweepDirectory

Executor = Callable[[Sequence[Cell]], Generator[Event, None, None]]
"""Computes cells in their order and yields events: `run_locally` or `run_on_cluster` with their settings bound."""


class Watcher(Protocol):
    """Receives the events of a sweep, such as a progress display."""

    def event(self, event: Event) -> None:
        """A cell was started, or is finished and on disk."""
        ...


def prepare(out: Path, spec: SweepSpec) -> tuple[SweepDirectory, Costs]:
    """Create the directory of a sweep, or open the one that is there; also return the predicted costs of its cells.

    Raises SweepError, WorldError, PresetError, LogError or OSError for unusable input; nothing is written then.
    """
    costs = Costs.of(spec)
    return SweepDirectory.prepare(out, Manifest(spec, code_version(), input_digests(spec), commit())), costs


def check_code(directory: SweepDirectory) -> None:
    """Raise SweepError if the source files have changed since the sweep was started: new workers would load others."""
    if current_code_version() != directory.manifest.code:
        raise SweepError(
            f"{directory.path}: the code has changed while the sweep ran (it was started with "
            f"{directory.manifest.code_words}); what is done is kept, and the same command goes on with that version"
        )


def pending(directory: SweepDirectory, cells: Sequence[Cell], costs: Costs, shard: Shard | None) -> list[Cell]:
    """Those of the cells that have no result, in the order of computation. Cells that failed are tried again."""
    cells = seed_by_seed(cells, costs)
    if shard is not None:
        cells = shard.of(cells, costs)
    return [cell for cell in cells if not directory.is_done(cell.key)]


def execute(directory: SweepDirectory, cells: Sequence[Cell], executor: Executor, watcher: Watcher) -> None:
    """Compute cells and write their results or failures to the directory."""
    with closing(executor(cells)) as events:  # closing the generator stops the workers
        for event in events:
            if isinstance(event, Finished):
                if isinstance(event.outcome, str):
                    directory.keep_failure(event.cell, event.outcome)
                else:
                    directory.keep(event.cell, event.outcome)
            watcher.event(event)
