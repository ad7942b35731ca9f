# SPDX-License-Identifier: MIT
"""What a view costs a real run: CPU time, encoding included, and bytes of the recording."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import worlds
from eval.map.grids import grid_from_true_map
from slam.config import FilterConfig
from testbed.run.estimation import Estimation
from testbed.run.snapshot import take_snapshot
from testbed.simulation import SimulationConfig, simulate
from testbed.simulation.physics.urdf import robot_urdf
from testbed.views import Scene, open_view


@pytest.mark.benchmark
def test_a_view_costs_little_of_the_run(tmp_path: Path) -> None:
    world, config = worlds.load("office"), SimulationConfig()
    recording = tmp_path / "recording.rrd"
    scene = Scene(
        title="office",
        particles=30,
        motion=FilterConfig().motion,
        true_map=grid_from_true_map(worlds.true_map(world)),
        robot_urdf=robot_urdf(config.robot),
    )
    estimation = Estimation(FilterConfig(particles=30), seed=0, threads=1)
    spent, stamp = [], 0.0
    process, thread = time.process_time(), time.thread_time()
    with simulate(world, config) as frames, open_view(recording, scene) as view:
        for frame in frames:
            report = estimation.process(frame)
            if report is not None:
                shown, stamp = take_snapshot(frame, report, estimation.mapper), frame.stamp
                before = time.thread_time()
                view.show(shown)
                spent.append(time.thread_time() - before)
        refined = estimation.refined(estimation.filtered())
        before = time.thread_time()
        view.finish(refined.at_scans.poses, refined.map)
        spent.append(time.thread_time() - before)
    total = time.process_time() - process
    encoding = total - (time.thread_time() - thread)  # with one thread of the filter the others are Rerun's
    share = (np.sum(spent) + encoding) / total
    megabytes = recording.stat().st_size / 1e6 * 600.0 / stamp
    mean = 1e3 * np.mean(spent)
    print(f"\n{mean:.2f} ms a snapshot, {100 * share:.1f} % of the CPU time, {megabytes:.0f} MB in ten minutes")  # noqa: T201
    assert share < 0.05
    assert megabytes < 60.0
