# SPDX-License-Identifier: MIT
"""SIGTERM, as batch systems and containers send it, ends every command as Ctrl-C does: cleanly, with status 130."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from testbed.datasets.simulated import is_complete
from tests.shell import AT_A_TERMINAL, TESTBED, call, without_waiting

LIMIT = 120.0
"""Longest time that anything here may take [s]."""

ENDS_SLOWLY = """
import atexit, signal, sys, time
sys.argv = ["testbed", *sys.argv[1:]]
signal.signal(signal.SIGINT, signal.default_int_handler)
atexit.register(lambda: (print("ends", file=sys.stderr, flush=True), time.sleep(100)))
from testbed.cli import main
main()
"""
"""A process that takes its time to end after the command has ended."""


def wait_until(condition, process: subprocess.Popen) -> None:
    deadline = time.monotonic() + LIMIT
    while not condition():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.002)


def catches_sigterm(process: subprocess.Popen) -> bool:
    """Whether a process has a handler of its own for SIGTERM."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except FileNotFoundError:
        return False
    caught = next((line for line in status.splitlines() if line.startswith("SigCgt:")), "SigCgt: 0")
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def is_running(pid: int) -> bool:
    """Whether a process runs; one that has ended and was not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def start(*arguments: str) -> subprocess.Popen:
    return subprocess.Popen([*TESTBED, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="reads the caught signals from /proc")
@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("command", ["run office --out run", "simulate office --out datasets", "sweep --worlds office"])
def test_sigterm_while_a_command_starts_ends_it_with_130(tmp_path, monkeypatch, command, delay):
    monkeypatch.chdir(tmp_path)
    process = start(*command.split())
    wait_until(lambda: catches_sigterm(process), process)
    time.sleep(delay)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "interrupted" in errors


@pytest.mark.slow  # four processes, twice; a killed job that goes on, and signals to other commands, are fast tests
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_simulate_leaves_whole_datasets_only(tmp_path, number):
    out = tmp_path / "datasets"
    arguments = ["simulate", "loop", "--out", str(out), "--count", "4", "--workers", "2", "--duration", "5"]
    process = subprocess.Popen(
        [*AT_A_TERMINAL, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    wait_until(lambda: out.is_dir() and any(path.name.startswith(".") for path in out.iterdir()), process)
    children = [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    process.send_signal(number)
    _, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 130
    *_, progress, last = without_waiting(errors)
    assert "of 4 datasets were made; the same command continues" in progress
    assert last == "testbed: interrupted"
    assert "Traceback" not in errors
    assert all(is_complete(path) for path in out.iterdir() if path.is_dir())
    deadline = time.monotonic() + LIMIT
    while any(map(is_running, children)) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not any(map(is_running, children))
    assert call(*arguments) == 0
    assert len([path for path in out.iterdir() if path.is_dir()]) == 4
    assert all(is_complete(path) for path in out.iterdir() if path.is_dir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("command", "status"), [("presets list", 0), ("worlds show nowhere", 2)])
def test_a_signal_after_the_end_of_a_command_does_not_change_its_status(number, command, status):
    """All is written then; only Python itself has to end."""
    command = [sys.executable, "-c", ENDS_SLOWLY, *command.split()]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    lines = without_waiting("".join(iter(process.stderr.readline, "ends\n")))
    process.send_signal(number)
    output, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == status
    assert errors == ""
    assert (len(lines), "burger" in output) == ((0, True) if status == 0 else (1, False))


def test_the_handler_of_the_caller_is_restored():
    before = signal.getsignal(signal.SIGTERM)
    assert call("run", "nowhere") == 2
    assert signal.getsignal(signal.SIGTERM) is before
