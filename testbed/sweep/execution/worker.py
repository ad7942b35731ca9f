# SPDX-License-Identifier: MIT
"""The process that computes cells: `python -m testbed.sweep.execution.worker`, one JSON document per line in and out.

It exits when its input ends, that is, when its parent process does. `testbed.sweep.execution.worker_process` starts it
and sets the environment of numba before.
"""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
from dataclasses import asdict
from typing import Any, TextIO

from testbed.sweep.execution.compute import compute
from testbed.sweep.spec.cell import Cell


def main() -> None:
    """Read cells and write their results until the input ends."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # C libraries may print to stdout
    cells: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(sys.stdin, cells), daemon=True).start()
    while True:
        answers.write(json.dumps(_answer(Cell(**json.loads(cells.get())))) + "\n")
        answers.flush()


def _answer(cell: Cell) -> dict[str, Any]:
    try:
        return {"result": asdict(compute(cell))}
    except Exception as error:  # any exception fails this cell only
        return {"failure": f"{type(error).__name__}: {' '.join(str(error).split())}"}


def _read(source: TextIO, cells: queue.SimpleQueue[str]) -> None:
    for line in source:
        cells.put(line)
    os._exit(0)  # the parent has exited: no process waits for the current cell


if __name__ == "__main__":
    main()
