# SPDX-License-Identifier: MIT
"""Computes cells on a dask.distributed cluster (optional extra `cluster`); results return over the network."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any, TypeVar

from testbed.sweep.errors import SweepError
from testbed.sweep.execution.local_pool import Event, Finished, outcome_of
from testbed.sweep.execution.worker_process import Limits, WorkerProcess
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import by_recording

CONNECT_SECONDS = 10.0
"""The scheduler must answer within this time [s]."""
MAX_BATCH = 8
"""A batch has at most this many cells: simulating once for 8 cells costs little, and results arrive soon."""
_of_this_thread = threading.local()
Job = TypeVar("Job")
Result = TypeVar("Result")


def run_on_cluster(cells: Sequence[Cell], address: str, limits: Limits) -> Generator[Event, None, None]:
    """Compute cells on the workers of a scheduler and yield each as its batch finishes.

    A batch is a few cells of one recording, so that it is simulated once for all of them. If a dask worker dies, dask
    gives its batch to another one, up to `allowed-failures`. Ending the iteration early cancels the batches that wait.
    Raises SweepError if `distributed` is not installed or the scheduler does not answer.
    """
    distributed = _import_distributed()
    with _client(distributed, address) as client:
        parts = batches(cells, sum(client.nthreads().values()))
        futures = {
            client.submit(
                compute_on_worker,
                [cell.document() for cell in part],
                asdict(limits),
                key=f"cells-{part[0].key}",
                priority=len(parts) - k,
                pure=False,
            ): part
            for k, part in enumerate(parts)
        }
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                for cell, outcome in zip(futures[future], _outcomes(future, len(futures[future])), strict=True):
                    yield Finished(cell, outcome)
        finally:
            client.cancel(list(futures), force=True)


def batches(cells: Sequence[Cell], threads: int) -> list[list[Cell]]:
    """Divide cells into batches of one recording each, in the order of their first cells.

    threads: how many cells the cluster computes at a time; a small sweep makes small batches, so that all are busy
    """
    size = min(MAX_BATCH, max(1, len(cells) // (2 * max(threads, 1))))
    return [group[k : k + size] for group in by_recording(cells) for k in range(0, len(group), size)]


def compute_on_cluster(
    function: Callable[[Job], Result], jobs: Sequence[Job], address: str
) -> Generator[tuple[Job, Result], None, None]:
    """Call `function` for jobs other than cells on the workers of a scheduler; yield each as it finishes.

    Errors of the function are raised. Ending the iteration early cancels the jobs that wait. Raises SweepError as
    `run_on_cluster` does.
    """
    distributed = _import_distributed()
    with _client(distributed, address) as client:
        futures = {client.submit(function, job, pure=False): job for job in jobs}
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                yield futures[future], future.result()
        finally:
            client.cancel(list(futures), force=True)


def compute_on_worker(cells: list[dict[str, Any]], limits: dict[str, Any]) -> list[dict[str, Any]]:
    """Compute cells on a dask worker, in a separate process that settings of the cluster do not reach.

    dask does not set numba's threads (distributed#9075), and a cell that crashes would end the dask worker.
    """
    process = getattr(_of_this_thread, "process", None)
    if process is None or process.limits != Limits(**limits):
        process = _of_this_thread.process = WorkerProcess(Limits(**limits))
    outcomes = [outcome_of(process, Cell(**cell)) for cell in cells]
    return [{"failure": out} if isinstance(out, str) else {"result": asdict(out)} for out in outcomes]


def _outcomes(future: Any, count: int) -> list[CellResult | str]:
    """Outcomes of a batch of `count` cells."""
    if future.status != "finished":
        error = future.exception() if future.status == "error" else future.status
        return [f"dask: {type(error).__name__}: {' '.join(str(error).split())}"] * count
    return [str(a["failure"]) if "failure" in a else CellResult(**a["result"]) for a in future.result()]


def _import_distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise SweepError("--scheduler needs dask: pip install 'slam-testbed[cluster]'") from None
    return distributed


@contextmanager
def _client(distributed: Any, address: str) -> Iterator[Any]:
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # ValueError: not an address at all
        raise SweepError(
            f"scheduler {address}: cannot be reached ({error}); expected such as tcp://host:8786"
        ) from None
    try:
        yield client
    finally:
        client.close()
