# SPDX-License-Identifier: MIT
"""A command that writes nothing says what it is doing; one that writes is left alone."""

import threading
import time
from contextlib import contextmanager

from testbed.cli.shared import console
from testbed.cli.shared.at_work import AtWork
from testbed.cli.shared.console import HeardConsole

PATIENCE = 60.0
"""So long may a thread take to say something on a busy machine [s]."""


@contextmanager
def listening(work, silence):
    """The lines that are said during the block, and an event that is set by the first."""
    lines, first = [], threading.Event()

    def say(line):
        lines.append(line)
        first.set()

    with work.watched(say, silence):
        yield lines, first


def test_a_silent_job_is_named():
    work = AtWork()
    with listening(work, 0.0) as (lines, first), work.doing("reading robot_bag"):
        first.clear()
        assert first.wait(PATIENCE)
    assert lines[-1] == "reading robot_bag: 0 s so far\n"


def test_what_was_done_before_is_named_again_after_a_block():
    work = AtWork()
    work.now_doing("scoring")
    with work.doing("reading a"):
        work.now_doing("reading b")
    with listening(work, 0.0) as (lines, first):
        assert first.wait(PATIENCE)
    assert lines[0].startswith("scoring: ")


def test_a_part_of_a_job_counts_from_the_begin_of_the_job():
    work = AtWork()
    work.now_doing("drive 3", time.perf_counter() - 1000.0)
    with listening(work, 0.0) as (lines, first):
        assert first.wait(PATIENCE)
    assert lines[0].startswith("drive 3: 10")


def test_a_job_that_was_heard_lately_is_left_alone():
    work = AtWork()
    with listening(work, 3600.0) as (lines, _):
        work.heard()
        time.sleep(0.5)
    assert lines == []


def test_what_a_console_prints_is_heard(monkeypatch, capsys):
    heard = []
    monkeypatch.setattr(console.AT_WORK, "heard", lambda: heard.append(1))
    HeardConsole(stderr=True).print("a line")
    assert heard
    assert capsys.readouterr().err == "a line\n"
