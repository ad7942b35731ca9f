# SPDX-License-Identifier: MIT
"""The parent's side of a worker: sends cells, receives results, kills the worker at its time or memory limit."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from testbed.sweep.errors import SweepError
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell

CHECK_PERIOD = 0.1
"""Period at which the limits are checked [s]."""
ONE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment of a worker; numba reads it on import, and a later setting would not free its idle threads."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of one cell."""

    seconds: float = 3600.0
    """Wall time [s]."""
    megabytes: float | None = None
    """Resident memory of the worker [MB]; None = no limit."""

    def __post_init__(self) -> None:
        if not self.seconds > 0.0:
            raise SweepError(f"time limit must be positive, got {self.seconds} s")
        if self.megabytes is not None and not self.megabytes > 0.0:
            raise SweepError(f"memory limit must be positive, got {self.megabytes} MB")


class CellFailedError(Exception):
    """A cell has no result. The message is the reason, in one line."""


class WorkerProcess:
    """One worker process. It is started at the first cell, and again after each cell that ended it.

    command: arguments of Python to start instead of the worker (for tests of the limits).
    """

    def __init__(self, limits: Limits, command: tuple[str, ...] = ("-m", "testbed.sweep.execution.worker")) -> None:
        self.limits = limits
        """Limits of one cell."""
        self._command = command
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes] | None = None
        self._stopped = False

    def compute(self, cell: Cell) -> CellResult:
        """Compute a cell; raises CellFailedError if it fails, exceeds a limit or ends the worker."""
        process = self._started()
        assert process.stdin is not None
        with suppress(OSError):  # the worker has exited: reading its answer reports that
            process.stdin.write(json.dumps(cell.document()).encode() + b"\n")
            process.stdin.flush()
        answer = json.loads(self._answer(process))
        if "failure" in answer:
            raise CellFailedError(answer["failure"])
        return CellResult(**answer["result"])

    def stop(self) -> None:
        """Kill the worker at once; a `compute` that waits for it fails."""
        self._stopped = True
        process = self._process  # the thread that computes may forget it meanwhile
        if process is not None:
            process.kill()
            process.wait()

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            self._errors = tempfile.TemporaryFile()  # noqa: SIM115  # lives as long as the process
            self._process = subprocess.Popen(
                [sys.executable, *self._command],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | ONE_THREAD,
                start_new_session=True,  # Ctrl-C must reach the parent only
            )
            if self._stopped:
                self._process.kill()
        return self._process

    def _answer(self, process: subprocess.Popen[bytes]) -> bytes:
        """Read the worker's next line; raises CellFailedError if it exits or exceeds a limit."""
        assert process.stdout is not None
        deadline = time.monotonic() + self.limits.seconds
        line = bytearray()
        while not line.endswith(b"\n"):
            ready, _, _ = select.select([process.stdout], [], [], CHECK_PERIOD)
            if ready:
                part = os.read(process.stdout.fileno(), 1 << 16)
                if not part:
                    raise CellFailedError(self._collect_exit(process))
                line += part
            elif time.monotonic() > deadline:
                self._kill(process, f"time limit of {self.limits.seconds:g} s")
            elif self.limits.megabytes is not None and resident_megabytes(process.pid) > self.limits.megabytes:
                self._kill(process, f"memory limit of {self.limits.megabytes:.0f} MB")
        return bytes(line)

    def _kill(self, process: subprocess.Popen[bytes], reason: str) -> None:
        process.kill()
        self._collect_exit(process)
        raise CellFailedError(reason)

    def _collect_exit(self, process: subprocess.Popen[bytes]) -> str:
        """Wait until the worker has exited, release it, and describe how it ended."""
        status = process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                _close(pipe)
        assert self._errors is not None
        self._errors.seek(0)
        last = self._errors.read().decode(errors="replace").strip().splitlines()[-1:]
        self._errors.close()
        self._process = None
        how = f"by {signal.Signals(-status).name}" if status < 0 else f"with exit status {status}"
        return ": ".join([f"the worker ended {how}", *last])


def _close(pipe: IO[bytes]) -> None:
    with suppress(OSError):  # unwritten data has no reader any more
        pipe.close()


def resident_megabytes(pid: int) -> float:
    """Resident memory of a process [MB]; 0 if it has exited or the system does not say (only Linux does)."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def fair_share_megabytes(workers: int) -> float:
    """Memory that each of `workers` processes may use on this machine [MB]: nine tenths, divided equally."""
    return 0.9 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e6 / workers
