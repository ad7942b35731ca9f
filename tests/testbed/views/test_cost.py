# SPDX-License-Identifier: MIT
"""What a view costs a run: CPU time, encoding included, and bytes of the recording."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest

import worlds
from eval.map.grids import grid_from_true_map
from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.estimation.snapshot import take_snapshot
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.simulation import SimulationConfig, simulate
from testbed.views import Scene, open_view

SETTLE_S = 0.5
"""Rerun's threads have written what they were given within this time [s]."""
INTEL = Path(__file__).parents[4] / "shared/datasets/intel/intel-910.clf.gz"


@dataclass(frozen=True)
class Cost:
    """What a view cost."""

    share: float
    """Of the run's CPU time: frames, filter, final pass and view."""
    per_update_ms: float
    megabytes: float
    seconds: float
    """Time that the run covers [s]."""

    def __str__(self) -> str:
        per_ten_minutes = self.megabytes * 600.0 / self.seconds
        return (
            f"{100 * self.share:.1f} % of the whole run's CPU time (reading, filter, final pass and recording, "
            f"with the threads that encode), {self.per_update_ms:.2f} ms an update, "
            f"{self.megabytes:.1f} MB, {per_ten_minutes:.0f} MB in ten minutes"
        )


def time_of_other_threads() -> float:
    """CPU time of all threads but this one so far [s]."""
    return time.process_time() - time.thread_time()


def cost_of(frames: Iterable[Frame], scene: Scene, recording: Path) -> Cost:
    """Map the frames, 30 particles and one thread, while a view records it."""
    estimation = Estimation(FilterConfig(particles=30), seed=0, threads=1)
    spent, updates, first, last = 0.0, 0, None, 0.0
    process, others = time.process_time(), time_of_other_threads()
    with open_view(recording, scene) as view:
        for frame in frames:
            report = estimation.process(frame)
            first, last = frame.stamp if first is None else first, frame.stamp
            if report is not None:
                before = time.thread_time()
                view.show(take_snapshot(frame, report, estimation.mapper))
                spent += time.thread_time() - before
                updates += report.updated
        time.sleep(SETTLE_S)
        others = time_of_other_threads() - others  # Rerun's: the filter has one thread
        refined = estimation.refined(estimation.filtered())  # whose linear algebra has threads of its own
        before, since = time.thread_time(), time_of_other_threads()
        view.finish(refined.at_scans.poses, refined.map)
    spent += time.thread_time() - before
    encoding = others + time_of_other_threads() - since
    total = time.process_time() - process
    assert first is not None
    cost = spent + encoding
    return Cost(cost / total, 1e3 * cost / updates, recording.stat().st_size / 1e6, last - first)


@pytest.mark.benchmark
def test_a_view_costs_little_of_a_simulated_run(tmp_path: Path) -> None:
    world, config = worlds.load("office"), SimulationConfig()
    scene = Scene(
        title="office",
        particles=30,
        motion=FilterConfig().motion,
        true_map=grid_from_true_map(worlds.true_map(world)),
    )
    with simulate(world, config) as frames:
        cost = cost_of(frames, scene, tmp_path / "recording.rrd")
    print(f"\noffice, simulated: {cost}")  # noqa: T201
    assert cost.share < 0.05
    assert cost.megabytes * 600.0 / cost.seconds < 60.0


@pytest.mark.benchmark
def test_a_view_costs_little_of_a_log_that_is_far_faster_than_the_robot(tmp_path: Path) -> None:
    if not INTEL.is_file():
        pytest.skip("the Intel log is not there")
    scene = Scene(title="Intel", particles=30, motion=FilterConfig().motion)
    for name in ("warm.rrd", "recording.rrd"):  # the first time pays for the start of Python's and Rerun's parts
        cost = cost_of(open_log(INTEL).frames, scene, tmp_path / name)
    print(f"\nIntel, a log: {cost}")  # noqa: T201
    assert cost.share < 0.08  # the aim, 0.05, is not met: docs/views.md
    assert cost.megabytes < 20.0
