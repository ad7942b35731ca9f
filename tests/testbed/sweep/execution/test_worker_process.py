# SPDX-License-Identifier: MIT
"""Workers: what a cell that crashes, hangs or eats memory does to the others, which is nothing."""

import pytest

from testbed.sweep.errors import SweepError
from testbed.sweep.execution.worker_process import CellFailedError, Limits, WorkerProcess, resident_megabytes
from tests.testbed.sweep.room import room_cell, room_file

FAKE = """
import json, os, sys, time
for line in sys.stdin:
    seed = json.loads(line)["seed"]
    if seed == 1:
        os.abort()
    if seed == 2:
        time.sleep(60)
    if seed == 3:
        kept = []
        while True:
            kept.append(b"x" * 20_000_000)
            time.sleep(0.01)
    if seed == 4:
        sys.exit("no more licences")
    answer = {"result": {"metrics": dict(os.environ), "curves": {}, "timing": {}}}
    print(json.dumps(answer if seed != 5 else {"failure": "ValueError: no"}), flush=True)
"""
"""A worker whose behaviour is chosen by the seed of the cell."""


@pytest.fixture
def worker(request):
    seconds = getattr(request, "param", 60.0)
    worker = WorkerProcess(Limits(seconds=seconds, megabytes=300.0), command=("-c", FAKE))
    yield worker
    worker.stop()


@pytest.fixture
def cell(tmp_path):
    world = room_file(tmp_path)
    return lambda seed: room_cell(world, seed=seed)


@pytest.mark.parametrize(
    ("worker", "seed", "reason"),
    [
        (60.0, 1, "the worker ended by SIGABRT"),
        (1.5, 2, "time limit of 1.5 s"),
        (60.0, 3, "memory limit of 300 MB"),
        (60.0, 4, "the worker ended with exit status 1: no more licences"),
        (60.0, 5, "ValueError: no"),
    ],
    indirect=["worker"],
)
def test_a_bad_cell_has_a_reason_and_the_next_is_computed(worker, cell, seed, reason):
    with pytest.raises(CellFailedError) as failed:
        worker.compute(cell(seed))
    assert str(failed.value) == reason
    assert worker.compute(cell(0)).metrics


def test_numba_has_one_thread_before_it_is_imported(worker, cell, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "8")
    environment = worker.compute(cell(0)).metrics
    assert environment["NUMBA_NUM_THREADS"] == environment["OMP_NUM_THREADS"] == "1"


def test_a_stopped_worker_is_gone(worker, cell):
    worker.compute(cell(0))
    assert worker._process is not None
    pid = worker._process.pid
    assert resident_megabytes(pid) > 1.0
    worker.stop()
    assert resident_megabytes(pid) == 0.0


def test_a_worker_ends_when_its_parent_has_gone(worker, cell):
    """The parent's end of the pipe is closed when it dies, however it dies."""
    ours = WorkerProcess(Limits(seconds=60.0))
    process = ours._started()
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(timeout=60.0) == 0  # TimeoutExpired where it does not end by itself


@pytest.mark.parametrize("limits", [{"seconds": 0.0}, {"seconds": float("nan")}, {"megabytes": -1.0}])
def test_limits_are_positive(limits):
    with pytest.raises(SweepError, match="must be positive"):
        Limits(**limits)
