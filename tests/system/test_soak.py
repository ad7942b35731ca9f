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
from testbed.formats import open_log
from tests.shell import call
from tests.testbed.cli.test_cli import room_log

REST = "not run to the end: runs 20 to 160 of one process, without pictures, go from 459 to 462 MB (453 to 466)"
MAX_GROWTH_MB = 20.0
"""Growth of the resident set over a soak, after the first runs have filled the caches [MB]."""


def resident_mb() -> float:
    """Memory of this process [MB]."""
    pages = Path("/proc/self/statm")
    if not pages.exists():
        pytest.skip("the resident set is read from /proc")
    gc.collect()
    return int(pages.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def assert_flat(repeat, warm_up: int, count: int) -> None:
    """Call `repeat(k)`; the memory after the first calls is about the memory at the end."""
    for k in range(warm_up):
        repeat(k)
    before = resident_mb()
    for k in range(warm_up, warm_up + count):
        repeat(k)
    grown = resident_mb() - before
    assert grown < MAX_GROWTH_MB, f"{grown:.1f} MB more after {count} repetitions"


def assert_runs_stay_flat(folder: Path, warm_up: int, count: int) -> None:
    log = room_log(folder / "room.log")

    def run(_: int) -> None:
        assert call("slam", log, "--particles", "2", "--overwrite", "--out", folder / "run") == 0

    assert_flat(run, warm_up, count)


def assert_resets_stay_flat(name: str, warm_up: int, count: int) -> None:
    environment = gymnasium.make(name, backend="fast")
    try:
        assert_flat(lambda k: environment.reset(seed=k), warm_up, count)
    finally:
        environment.close()


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.xfail(reason=REST, strict=False)
def test_a_thousand_runs_of_one_process_stay_flat(tmp_path):
    assert_runs_stay_flat(tmp_path, 20, 1000)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", ["testbed/Drive-v0", "testbed/Explore-v0"])
def test_ten_thousand_resets_stay_flat(name):
    assert_resets_stay_flat(name, 100, 10_000)


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
