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

CONNECT_SECONDS = 10.0
"""The scheduler must answer within this time [s]."""
_of_this_thread = threading.local()
Job = TypeVar("Job")
Result = TypeVar("Result")


def run_on_cluster(cells: Sequence[Cell], address: str, limits: Limits) -> Generator[Event, None, None]:
    """Compute cells in their order on the workers of a scheduler and yield each as it finishes.

    If a dask worker dies, dask gives its cell to another one, up to `allowed-failures`. Ending the iteration early
    cancels the cells that wait. Raises SweepError if `distributed` is not installed or the scheduler does not answer.
    """
    distributed = _import_distributed()
    with _client(distributed, address) as client:
        futures = {
            client.submit(
                compute_on_worker,
                cell.document(),
                asdict(limits),
                key=f"cell-{cell.key}",
                priority=len(cells) - k,
                pure=False,
            ): cell
            for k, cell in enumerate(cells)
        }
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                yield Finished(futures[future], _outcome(future))
        finally:
            client.cancel(list(futures), force=True)


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


def compute_on_worker(cell: dict[str, Any], limits: dict[str, Any]) -> dict[str, Any]:
    """Compute a cell on a dask worker, in a separate process that settings of the cluster do not reach.

    dask does not set numba's threads (distributed#9075), and a cell that crashes would end the dask worker.
    """
    process = getattr(_of_this_thread, "process", None)
    if process is None or process.limits != Limits(**limits):
        process = _of_this_thread.process = WorkerProcess(Limits(**limits))
    outcome = outcome_of(process, Cell(**cell))
    return {"failure": outcome} if isinstance(outcome, str) else {"result": asdict(outcome)}


def _outcome(future: Any) -> CellResult | str:
    if future.status != "finished":
        error = future.exception() if future.status == "error" else future.status
        return f"dask: {type(error).__name__}: {' '.join(str(error).split())}"
    answer = future.result()
    return str(answer["failure"]) if "failure" in answer else CellResult(**answer["result"])


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
