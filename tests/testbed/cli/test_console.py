# SPDX-License-Identifier: MIT
"""Messages of the console: a long job is not silent, a short one is."""

import threading

import pytest

import worlds
from testbed.cli.shared import console
from testbed.cli.shared.console import Overdue, SlowProgress, announce_world, counted_seconds, progress_line


def test_a_long_job_prints_its_share_and_a_short_one_nothing(capsys):
    slow, quick = SlowProgress("planning a tour", every=0.0), SlowProgress("planning a tour", every=60.0)
    for share in (0.25, 1.0):
        slow(share)
        quick(share)
    assert capsys.readouterr().err.splitlines() == ["planning a tour: 25%", "planning a tour: 100%"]


def test_a_world_in_centimetres_is_questioned(capsys):
    wall = worlds.Wall(points=[(0.0, 0.0), (800.0, 0.0), (800.0, 600.0), (0.0, 600.0)], closed=True, thickness=10.0)
    announce_world(worlds.World(name="hall", start=worlds.Start(x=400.0, y=300.0), walls=[wall]))
    announce_world(worlds.load("office"))
    (line,) = capsys.readouterr().err.splitlines()
    assert "is it in centimetres?" in line


def test_without_a_terminal_a_long_run_prints_lines_and_a_short_one_none(capsys, monkeypatch):
    for period, expected in ((60.0, 0), (-1.0, 5)):
        monkeypatch.setattr(console, "REPORT_PERIOD", period)
        with progress_line() as line:
            line.stage("mapping")
            line.step(100.0, 0.0, None)
            line.step(130.0, 0.25, 0.012)
            line.stage("final pass")
            line.share(0.4)
            line.stage("scoring")
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == expected
    assert lines[1].startswith("25% done, about 0 s left: 30.0 s of the drive ")
    assert lines[1].endswith(" x real time position error 0.012 m")
    expected = ["final pass, about 0 s …", "final pass: 40% done, about 0 s left", "scoring, about 4 s …"]
    assert lines[2:] == expected


def test_seconds_are_counted_where_it_takes_long(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(console.time, "perf_counter", lambda: now[0])
    with counted_seconds() as say:
        for number, now[0] in enumerate((100.0, 103.0, 105.0, 106.0, 112.0), start=1):
            say(f"measuring drive {number} of 5")
    expected = ["measuring drive 3 of 5: 5 s so far", "measuring drive 5 of 5: 12 s so far"]
    assert capsys.readouterr().err.splitlines() == expected


def test_a_stage_that_takes_longer_says_so_until_it_ends():
    said, twice = [], threading.Event()

    def say(text):
        said.append(text)
        if len(said) == 2:
            twice.set()

    overdue = Overdue("final pass", 0.0, say, every=0.01)
    assert twice.wait(30.0)
    overdue.stop()
    count = len(said)
    assert all("final pass: taking longer than expected, 0 s so far" in text for text in said[:2])
    quick = Overdue("final pass", 3600.0, say, every=0.01)
    quick.stop()
    assert len(said) == count


def test_the_time_left_does_not_count_what_another_process_compiled(capsys, monkeypatch):
    now = [0.0]
    counts = [(0.0, 50), (900.0, 100), (910.0, 1), (940.0, 10)]

    def compile_kernels(show):
        for now[0], done in counts:
            show(done, 100)
        return 1030.0

    monkeypatch.setattr(console.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(console, "is_compiled", lambda: False)
    monkeypatch.setattr(console, "compile_kernels", compile_kernels)
    console.announce_compilation()
    lines = capsys.readouterr().err.splitlines()
    assert lines[1:-1] == [
        "kernels compiled: 100 of 100, the last ones take longest",
        "kernels of another installation that shares the cache; now those of this one",
        "kernels compiled: 10 of 100, about 270 s left",
    ]


@pytest.mark.parametrize(("done", "said"), [(0.001, "0% done"), (0.04, "4% done"), (0.5, "50% done, about 10 s left")])
def test_the_time_left_is_said_once_it_can_be_told(done, said, monkeypatch):
    monkeypatch.setattr(console.time, "perf_counter", lambda: 10.0)
    assert console._left(0.0, done) == said
