# SPDX-License-Identifier: MIT
"""Output of the commands: results on stdout, progress and messages on stderr, so that results can be piped."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from testbed.cli.shared.at_work import AT_WORK
from testbed.kernels import compile_kernels, is_compiled

if TYPE_CHECKING:
    from worlds import World


class HeardConsole(Console):
    """A console whose lines break the silence of a command (`AtWork`)."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print, see `rich.console.Console.print`."""
        super().print(*objects, **options)
        AT_WORK.heard()


console = HeardConsole(stderr=True, highlight=False)
"""Console for progress and messages."""
results = HeardConsole(highlight=False, soft_wrap=True)
"""Console for results."""


MIN_COMPILED = 5
"""How long the rest will take is guessed from this many kernels on."""
LARGE_KERNELS = 8
"""So many of the last kernels take several times as long as the others: no time is guessed from then on."""
COMPILATION_PERIOD = 4.0
"""Time between two lines about the kernels where stderr is no terminal [s]."""


def announce_compilation() -> None:
    """Compile the kernels if they are not compiled yet, and say so, because it takes a while."""
    if is_compiled():
        return
    started = said = time.perf_counter()
    before = 0
    console.print("Compiling the kernels: once per version, about half a minute on two free cores …")
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("kernels compiled: none yet", total=None)

        def show(done: int, total: int) -> None:
            nonlocal said, started, before
            now = time.perf_counter()
            if done < before:  # the count so far was that of another process, which has ended
                started = said = now
                if not console.is_terminal:
                    console.print("kernels of another installation that shares the cache; now those of this one")
            before = done
            left = (now - started) * (total - done) / max(done, 1)
            state = f"{done} of {total}"
            if total - done <= LARGE_KERNELS:
                state += ", the last ones take longest"
            elif done >= MIN_COMPILED:
                state += f", about {left:.0f} s left"
            progress.update(task, description=f"kernels compiled: {state}")
            if not console.is_terminal and now - said > COMPILATION_PERIOD:
                said = now
                console.print(f"kernels compiled: {state}")

        seconds = compile_kernels(show)
    console.print(f"The kernels were compiled in {seconds:.0f} s and are kept on disk.")


@contextmanager
def counted_seconds() -> Iterator[Callable[[str], None]]:
    """Give a function that says what is done from now on, and show for how many seconds the block has run; if stderr is
    no terminal, print a line every few seconds."""
    started = said = time.perf_counter()
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None)

        def say(job: str) -> None:
            nonlocal said
            now = time.perf_counter()
            progress.update(task, description=job)
            AT_WORK.now_doing(job, started)
            if not console.is_terminal and now - said > REPORT_PERIOD:
                said = now
                console.print(f"{job}: {now - started:.0f} s so far", soft_wrap=True)

        yield say


class SlowProgress:
    """Progress of a job that is usually short: prints the share that is done every few seconds once it takes long."""

    def __init__(self, job: str, *, every: float = 4.0) -> None:
        self._job, self._every, self._next = job, every, time.perf_counter() + every

    def __call__(self, share: float) -> None:
        """Print the share that is done, 0 to 1, if the last line was long ago."""
        now = time.perf_counter()
        if now >= self._next:
            console.print(f"{self._job}: {share:.0%}")
            self._next = now + self._every


def announce_world(world: World) -> None:
    """Print what is doubtful about a world."""
    from worlds.check import unit_notes  # takes a geometry library along

    for note in unit_notes(world):
        console.print(f"note: {note}", soft_wrap=True)


FINAL_PASS_SHARE = 0.25
"""The final pass takes about this share of the time that the drive before it took (office, Intel)."""
FINAL_PASS_SCAN_S = 0.0017
"""… and at least so long for each scan [s] (maze with five particles)."""
EXPECTED_S = {"scoring": 4.0, "report": 12.0}
"""What comes after it takes about so long on two free cores [s]."""
REPORT_PERIOD = 4.0
"""Time between two lines where stderr is no terminal [s]: short jobs print none."""
OVERDUE_PERIOD = 10.0
"""Time between two lines about a stage that takes longer than expected, at the least [s]."""
TELLING_SHARE = 0.05
"""How long the rest of a stage will take is said once so much of it is done."""


class Overdue:
    """Says again and again, from a thread of its own, that a stage takes longer than expected."""

    def __init__(
        self, stage: str, expected: float, say: Callable[[str], None], *, every: float = OVERDUE_PERIOD
    ) -> None:
        """Begin with the first line when the expected time [s] has passed twice over, or `every` [s] after it."""
        self._stage, self._expected, self._say, self._every = stage, expected, say, every
        self._started, self._ended = time.perf_counter(), Event()
        self._thread = Thread(target=self._wait, daemon=True)
        self._thread.start()

    def _wait(self) -> None:
        waiting, why = self._expected + max(self._expected, self._every), "; a busy machine takes several times as long"
        while not self._ended.wait(waiting):
            seconds = time.perf_counter() - self._started
            expected = f"expected about {self._expected:.0f} s{why}"
            self._say(f"{self._stage}: taking longer than expected, {seconds:.0f} s so far ({expected})")
            waiting, why = max(self._every, 0.5 * seconds), ""

    def stop(self) -> None:
        """Say nothing more."""
        self._ended.set()
        self._thread.join()


class ProgressLine:
    """A line with a bar, the time in the recording, the real-time factor and the current error.

    It implements `testbed.run.execute.RunProgress`.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task = progress.add_task("starting", total=None, status="")
        self._started = self._reported = time.perf_counter()
        self._stage, self._stage_started = "", self._started
        self._first_stamp: float | None = None
        self._said = False  # whether a line was printed: short jobs print none
        self._scans = 0
        self._overdue: Overdue | None = None

    def stage(self, text: str) -> None:
        """Show that a new stage of the job begins."""
        self.stop()
        self._stage, self._stage_started = text, time.perf_counter()
        expected = EXPECTED_S.get(text)
        if text == "final pass" and self._first_stamp is not None:
            expected = FINAL_PASS_SHARE * (time.perf_counter() - self._started)
            expected = max(expected, FINAL_PASS_SCAN_S * self._scans)
        if expected is not None:
            self._overdue = Overdue(text, expected, self._say_overdue)
            text += f", about {expected:.0f} s"
        AT_WORK.now_doing(text)
        self._progress.remove_task(self._task)  # a task of unknown length cannot be made of one whose length is known
        self._task = self._progress.add_task(text, total=None, status="")
        if not console.is_terminal and self._said:
            console.print(f"{text} …", soft_wrap=True)

    def stop(self) -> None:
        """Say nothing more about the stage."""
        if self._overdue is not None:
            self._overdue.stop()
            self._overdue = None

    def _say_overdue(self, text: str) -> None:
        """Show that the stage takes longer than expected."""
        self._progress.update(self._task, description=text)
        if not console.is_terminal:
            console.print(text, soft_wrap=True)

    def step(self, stamp: float, share: float | None, error: float | None) -> None:
        """Show that one scan is done, see `RunProgress.step`."""
        if self._first_stamp is None:
            self._first_stamp, self._started = stamp, time.perf_counter()
        self._scans += 1
        seconds = stamp - self._first_stamp
        factor = seconds / max(time.perf_counter() - self._started, 1e-9)
        status = f"{seconds:7.1f} s of the drive  {factor:5.1f} x real time"
        status += "" if error is None else f"  position error {error:.3f} m"
        self._progress.update(self._task, total=None if share is None else 1.0, completed=share or 0.0, status=status)
        if not console.is_terminal and time.perf_counter() - self._reported > REPORT_PERIOD:
            self._reported, self._said = time.perf_counter(), True
            console.print(f"{self._done(share)}{' '.join(status.split())}", soft_wrap=True)

    def part(self, text: str) -> None:
        """Show which part of the stage is done now."""
        text = f"{self._stage}, {text}"
        self._progress.update(self._task, description=text)
        AT_WORK.now_doing(text, self._stage_started)

    def share(self, done: float) -> None:
        """Show which part of the stage is done, see `RunProgress.share`."""
        self._progress.update(self._task, total=1.0, completed=done)
        if not console.is_terminal and time.perf_counter() - self._reported > REPORT_PERIOD:
            self._reported, self._said = time.perf_counter(), True
            console.print(f"{self._stage}: {_left(self._stage_started, done)}", soft_wrap=True)

    def _done(self, share: float | None) -> str:
        """The share that is done, 0 to 1, and about how long the rest will take; empty where that is unknown."""
        return f"{_left(self._started, share)}: " if share else ""


def _left(started: float, share: float) -> str:
    """The share, 0 to 1, that is done since `started`, and about how long the rest will take, once that can be told."""
    if share < TELLING_SHARE:
        return f"{share:.0%} done"
    return f"{share:.0%} done, about {(time.perf_counter() - started) * (1.0 - share) / share:.0f} s left"


@contextmanager
def progress_line() -> Iterator[ProgressLine]:
    """Show a progress line during the block; if stderr is no terminal, print a line from time to time."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description:<14}"),
        BarColumn(bar_width=30),
        TimeElapsedColumn(),
        TextColumn("{task.fields[status]}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        line = ProgressLine(progress)
        try:
            yield line
        finally:
            line.stop()
