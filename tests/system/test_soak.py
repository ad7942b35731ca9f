# SPDX-License-Identifier: MIT
"""One process that works for a long time keeps its memory: no run, and no episode, leaves anything behind."""

import gc
import os
from pathlib import Path

import gymnasium
import pytest

import testbed  # noqa: F401  registers the environments
from slam.config import FilterConfig
from slam.gmapping import GMapping
from testbed.estimation.snapshot import take_snapshot
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.views import open_view
from tests.shell import call
from tests.testbed.cli.test_cli import room_log
from tests.testbed.views.synthetic import scan_at, scene, truth_at

MAX_GROWTH_MB = 20.0
"""Growth of the resident set over a soak, after the first runs have filled the caches [MB]."""
OF_A_RUN_MB = 0.2
"""What one whole run of the command may leave in the process. 0.1 MB were seen over 540 runs (462 to 517 MB), most
of it in the allocator of rerun (0.41): objects, threads and open files stay as many, and mapping alone stays flat."""
OF_A_DRAWN_SCAN_MB = 0.001
"""What one scan of a recorded drive may leave: paths that are drawn, and what rerun keeps (600 bytes were seen)."""


def resident_mb() -> float:
    """Memory of this process [MB]."""
    pages = Path("/proc/self/statm")
    if not pages.exists():
        pytest.skip("the resident set is read from /proc")
    gc.collect()
    return int(pages.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def assert_flat(repeat, warm_up: int, count: int, growth_mb: float = MAX_GROWTH_MB) -> None:
    """Call `repeat(k)`; the memory after the first calls is about the memory at the end."""
    for k in range(warm_up):
        repeat(k)
    before = resident_mb()
    for k in range(warm_up, warm_up + count):
        repeat(k)
    after = resident_mb()
    print(f"{count} repetitions: {before:.1f} to {after:.1f} MB")  # noqa: T201  shown by pytest -rP
    assert after - before < growth_mb, f"{after - before:.1f} MB more after {count} repetitions"


def assert_runs_stay_flat(folder: Path, warm_up: int, count: int) -> None:
    log = room_log(folder / "room.log")

    def run(_: int) -> None:
        assert call("slam", log, "--particles", "2", "--overwrite", "--out", folder / "run") == 0

    assert_flat(run, warm_up, count, OF_A_RUN_MB * count)


def assert_resets_stay_flat(name: str, warm_up: int, count: int) -> None:
    environment = gymnasium.make(name, backend="fast")
    try:
        assert_flat(lambda k: environment.reset(seed=k), warm_up, count)
    finally:
        environment.close()


def scans_at_40_hertz(recording: Path | None = None):
    """What maps scan k (24 beams) of a robot that drives round and round in a room, and the view of its recording."""
    mapper = GMapping(FilterConfig(particles=2), seed=0, threads=1)
    view = None if recording is None else open_view(recording, scene())

    def step(k: int) -> None:
        stamp = k / 40.0
        pose = truth_at(stamp)
        frame = Frame(stamp=stamp, odometry=pose, scan=scan_at(pose, stamp, beams=24), truth=pose)
        report = mapper.process(pose, frame.scan)
        if view is not None:
            view.show(take_snapshot(frame, report, mapper))

    return step, view


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_a_thousand_runs_of_one_process_leave_little(tmp_path):
    assert_runs_stay_flat(tmp_path, 20, 1000)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", ["testbed/Drive-v0", "testbed/Explore-v0"])
def test_ten_thousand_resets_stay_flat(name):
    assert_resets_stay_flat(name, 100, 10_000)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_an_hour_at_40_hertz_stays_flat():
    """144,000 scans as fast as they are mapped."""
    step, _ = scans_at_40_hertz()
    assert_flat(step, 4000, 140_000)


def test_a_minute_at_40_hertz_stays_flat():
    step, _ = scans_at_40_hertz()
    assert_flat(step, 400, 2000)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_an_hour_at_40_hertz_with_its_recording_leaves_little(tmp_path):
    step, view = scans_at_40_hertz(tmp_path / "recording.rrd")
    with view:
        assert_flat(step, 4000, 140_000, OF_A_DRAWN_SCAN_MB * 140_000)


def test_estimates_without_a_recording_stay_flat(tmp_path):
    """Reading a log and mapping it, as a sweep does in its workers."""
    log = room_log(tmp_path / "room.log")

    def estimate(seed: int) -> None:
        mapper = GMapping(FilterConfig(particles=2), seed=seed)
        for frame in open_log(log).frames:
            if frame.scan is not None:
                mapper.process(frame.odometry, [frame.scan])

    assert_flat(estimate, 10, 100)


@pytest.mark.parametrize("name", ["testbed/Drive-v0", "testbed/Explore-v0"])
def test_a_hundred_resets_stay_flat(name):
    assert_resets_stay_flat(name, 10, 100)
