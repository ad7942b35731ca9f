# SPDX-License-Identifier: MIT
"""Live viewers: what they get while the run goes on, and that the worst of them costs the run nothing."""

from __future__ import annotations

import io
import itertools
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import rerun as rr
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.views import Snapshot, View, ViewOptions, open_view
from testbed.views.live import programs, relay
from testbed.views.live.relay import batches
from testbed.views.rerun import entities
from tests.testbed.views.conftest import Recorded
from tests.testbed.views.synthetic import scene, snapshots


class Growing(io.BytesIO):
    """A file that has grown by one piece at each look."""

    def __init__(self, pieces: list[bytes], gone: threading.Event) -> None:
        super().__init__()
        self._pieces, self._gone = iter(pieces), gone

    def read(self, size: int | None = -1) -> bytes:
        piece = next(self._pieces, None)
        if piece is None:
            self._gone.set()
        return piece or b""


def row_counts(path: Path) -> Counter[str]:
    """Rows per entity."""
    counts: Counter[str] = Counter()
    reader = rr.chunk.RrdReader(path)
    if reader.recordings():
        for chunk in reader.stream():
            counts[chunk.entity_path] += chunk.num_rows
    return counts


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("relay") / "recording.rrd"
    with open_view(path, scene()) as view:
        for snapshot in snapshots(1.0):
            view.show(snapshot)
    return path


@settings(max_examples=6, deadline=None)
@given(cuts=st.lists(st.floats(0.0, 1.0), max_size=12))
@pytest.mark.filterwarnings("ignore::rerun.error_utils.RerunWarning")
def test_nothing_is_lost_or_doubled_however_the_file_grows(
    short: Path, tmp_path_factory: pytest.TempPathFactory, cuts: list[float]
) -> None:
    whole = short.read_bytes()
    edges = [0, *sorted(round(cut * len(whole)) for cut in cuts), len(whole)]
    pieces = [whole[a:b] for a, b in itertools.pairwise(edges)]
    part = tmp_path_factory.mktemp("part") / "part.rrd"
    received: Counter[str] = Counter()
    for batch in batches(Growing(pieces, threading.Event()), threading.Event()):
        part.write_bytes(batch)
        received += row_counts(part)
    assert received == row_counts(short)


def test_a_recording_that_was_cut_off_is_relayed_as_far_as_it_goes(short: Path) -> None:
    gone = threading.Event()
    cut = short.read_bytes()[:-5000]
    assert sum(len(batch) for batch in batches(Growing([cut], gone), gone)) > 0  # and it ends


@contextmanager
def nobody() -> Iterator[str]:
    yield programs.proxy_url(programs.free_port())


@contextmanager
def mute() -> Iterator[str]:
    """Takes connections and never says a word."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        yield programs.proxy_url(listener.getsockname()[1])


@contextmanager
def stopped() -> Iterator[str]:
    """A server that is frozen right after its start."""
    port, web_port = programs.free_port(), programs.free_port()
    command = programs.server_command(port, web_port)
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 20.0
        while time.monotonic() < deadline:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.1)
        os.kill(server.pid, signal.SIGSTOP)
        yield programs.proxy_url(port)
    finally:
        server.kill()
        server.wait()


def processor_time(view: View, snapshots: list[Snapshot]) -> float:
    """Seconds of the processor that this thread spends on showing the snapshots."""
    used = time.thread_time()
    for snapshot in snapshots:
        view.show(snapshot)
    return time.thread_time() - used


@pytest.mark.parametrize("listener", [nobody, mute, stopped])
def test_a_broken_viewer_neither_stops_nor_slows_the_run(listener, recorded: Recorded, tmp_path: Path) -> None:
    """A run that waited for the viewer would wait for ever; pytest's timeout would tell."""
    path = tmp_path / "recording.rrd"
    alone = open_view(tmp_path / "alone.rrd", scene(), ViewOptions())
    expected_time = processor_time(alone, recorded.snapshots)
    alone.close()
    with listener() as url:
        view = open_view(path, scene(), ViewOptions(connect=url))
        used = processor_time(view, recorded.snapshots)
        view.close()
    assert used < 3.0 * expected_time
    written, expected = row_counts(path), row_counts(recorded.path)
    for entity in (entities.ESTIMATED_ROBOT, entities.SCAN, entities.PARTICLES, entities.EVENTS):
        assert written[entity] == expected[entity]


@pytest.mark.parametrize("is_awaited", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_process_whose_viewer_hangs_ends_at_once(tmp_path: Path, is_awaited: bool) -> None:
    """Its relay ends too, when the time for the last delivery is over, which is awaited in the slow case."""
    program = f"""
from pathlib import Path
from testbed.views import ViewOptions, open_view
from tests.testbed.views.synthetic import scene, snapshots
import sys
with open_view(Path({str(tmp_path / "recording.rrd")!r}), scene(), ViewOptions(connect=sys.argv[1])) as view:
    for snapshot in snapshots(1.0):
        view.show(snapshot)
print("done", flush=True)
"""
    with mute() as url:
        process = subprocess.Popen([sys.executable, "-c", program, url], stdout=subprocess.PIPE)
        assert process.stdout is not None
        assert process.stdout.readline() == b"done\n"
        assert process.wait(timeout=3.0) == 0
        left = relays_of(tmp_path)
        assert len(left) == 1
        deadline = time.monotonic() + 2.0 * relay.LAST_DELIVERY
        while is_awaited and relays_of(tmp_path) and time.monotonic() < deadline:
            time.sleep(0.2)
        if is_awaited:
            assert not relays_of(tmp_path)
        else:
            os.kill(left[0], signal.SIGKILL)


def relays_of(folder: Path) -> list[int]:
    """Processes that relay a recording in a folder."""
    found = []
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended
            command = process.read_bytes()
            if b"live.relay" in command and str(folder).encode() in command:
                found.append(int(process.parent.name))
    return found


def test_a_lost_viewer_is_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with nobody() as url, open_view(tmp_path / "recording.rrd", scene(), ViewOptions(connect=url)) as view:
        shown = iter(snapshots(60.0))
        deadline = time.monotonic() + 20.0
        with caplog.at_level(logging.WARNING):
            while not caplog.records and time.monotonic() < deadline:
                view.show(next(shown))
                time.sleep(0.05)
            for _ in range(3):
                view.show(next(shown))
    assert len(caplog.records) == 1
    assert "nobody listens" in caplog.records[0].getMessage()


def test_a_window_without_a_display_costs_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(programs, "display_missing", lambda: True)
    with open_view(tmp_path / "recording.rrd", scene(), ViewOptions(window=True)) as view:
        view.show(next(iter(snapshots(0.0))))
    assert ["no display" in record.getMessage() for record in caplog.records] == [True]


def test_the_web_page_and_its_data_are_served_on_loopback_until_the_run_lets_go(tmp_path: Path) -> None:
    from urllib.parse import parse_qs, urlsplit
    from urllib.request import urlopen

    view = open_view(tmp_path / "recording.rrd", scene(), ViewOptions(serve=True))
    try:
        assert view.address is not None
        parts = urlsplit(view.address)
        assert parts.hostname == "127.0.0.1"
        deadline = time.monotonic() + 30.0
        page = b""
        while not page and time.monotonic() < deadline:
            try:
                page = urlopen(view.address, timeout=5.0).read()
            except OSError:
                time.sleep(0.2)
        assert b"<html" in page.lower()
        source = urlsplit(parse_qs(parts.query)["url"][0])
        socket.create_connection((source.hostname, source.port), timeout=5.0).close()
        for snapshot in snapshots(1.0):
            view.show(snapshot)
    finally:
        view.close()
    viewer = view._viewers[0]  # type: ignore[attr-defined]
    assert viewer._process.poll() is None  # still there to be looked at
    viewer._process.stdin.close()  # what the end of the run's process does
    assert viewer._process.wait(timeout=20.0) == 0
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", parts.port)) != 0
