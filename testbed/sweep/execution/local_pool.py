# SPDX-License-Identifier: MIT
"""Computes many cells on one machine: one thread per worker process hands it one cell after the other."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Hashable, Sequence
from dataclasses import dataclass, replace

from testbed.sweep.execution.cell_queue import CellQueue
from testbed.sweep.execution.worker_process import CellFailedError, Limits, WorkerProcess, fair_share_megabytes
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell, recording_key


@dataclass(frozen=True, eq=False)
class Started:
    """A worker has started a cell."""

    cell: Cell


@dataclass(frozen=True, eq=False)
class Finished:
    """A cell is finished: `outcome` is its result, or the reason why it has none."""

    cell: Cell
    outcome: CellResult | str


Event = Started | Finished


def run_locally(cells: Sequence[Cell], workers: int, limits: Limits) -> Generator[Event, None, None]:
    """Compute cells on `workers` processes and yield an event as each starts and finishes.

    Cells of one recording go to one worker, which keeps it, and recordings are begun in the order of their first cells.
    If the limits name no memory, each worker may use its share of the machine's. Ending the iteration early, by
    Ctrl-C or `close`, stops the workers at once.
    """
    if limits.megabytes is None:
        limits = replace(limits, megabytes=fair_share_megabytes(workers))
    waiting = CellQueue(cells, recording_key)
    events: queue.SimpleQueue[Event | BaseException] = queue.SimpleQueue()
    processes = [WorkerProcess(limits) for _ in range(min(workers, len(cells)))]
    threads = [threading.Thread(target=_serve, args=(process, waiting, events)) for process in processes]
    for thread in threads:
        thread.start()
    left = len(cells)
    try:
        while left:
            event = events.get()
            if isinstance(event, BaseException):
                raise event
            left -= isinstance(event, Finished)
            yield event
    finally:
        waiting.clear()
        for process in processes:
            process.stop()
        for thread in threads:
            thread.join()


def _serve(process: WorkerProcess, waiting: CellQueue, events: queue.SimpleQueue[Event | BaseException]) -> None:
    """Feed one worker until no cell is waiting."""
    recording: Hashable | None = None
    try:
        while (taken := waiting.take(recording)) is not None:
            recording, cell = taken
            events.put(Started(cell))
            events.put(Finished(cell, outcome_of(process, cell)))
    except BaseException as error:  # such as a process that cannot be started: the iterating thread raises it
        events.put(error)


def outcome_of(process: WorkerProcess, cell: Cell) -> CellResult | str:
    """Compute a cell; return its result, or the reason why it has none."""
    try:
        return process.compute(cell)
    except CellFailedError as failure:
        return str(failure)
