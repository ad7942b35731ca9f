# SPDX-License-Identifier: MIT
"""A run says of itself whether it is lost, and no truth takes part in it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eval.limits import Limit
from slam.config import FilterConfig, MotionConfig
from testbed.cli.shared.console import progress_line
from testbed.estimation.self_check import localization_self_check
from testbed.run.execute import execute_job
from testbed.run.job import Job, RecordedFrames
from testbed.run.run_directory import RunDirectory
from testbed.simulation import SimulationConfig, simulate
from testbed.stress.perturbations import slip, thin_scans
from testbed.systems.filter_system import FilterSystem
from worlds import load

OLD = FilterConfig(particles=2, motion=MotionConfig(jump_share=0.0, failure_share=0.0))
"""A filter that takes neither slip nor jump for possible."""


@pytest.fixture(scope="module")
def frames():
    config = SimulationConfig(backend="fast", duration=25.0)
    with simulate(load("apartment"), config) as simulation:
        return list(thin_scans(simulation, 0.2))


def metrics_of(frames, folder, config):
    job = Job(source=RecordedFrames(frames), document={}, seed=0, system=FilterSystem(config, refine=True, threads=1))
    with progress_line() as watcher:
        execute_job(job, RunDirectory.create(folder), watcher)
    return json.loads((folder / "metrics.json").read_text())


@pytest.fixture(scope="module")
def lost(frames, tmp_path_factory):
    """The wheels spin by 100 degrees after 12 seconds, which this filter believes."""
    spun = list(slip(frames, 12.0, np.array([0.3, 0.0, np.radians(100.0)])))
    return metrics_of(spun, tmp_path_factory.mktemp("runs") / "lost", OLD)


def test_a_good_run_is_plausible(frames, tmp_path):
    metrics = metrics_of(frames, tmp_path / "good", OLD)
    assert metrics["outcome"] == "ok"
    check = metrics["self_check"]
    assert check["verdict"] == check["while_driving"]["verdict"] == "plausible"
    assert check["stamp"] is check["place"] is check["time_s"] is None


def test_a_lost_run_is_named_with_time_place_and_reason(lost):
    assert lost["outcome"] == "lost"
    check = lost["self_check"]
    assert check["verdict"] == check["while_driving"]["verdict"] == "lost"
    assert 11.5 < check["time_s"] < 14.0
    assert len(check["place"]) == 3
    assert "of the beams contradict the map" in check["reason"]


def test_the_check_sees_no_truth(frames, lost, tmp_path):
    spun = slip(frames, 12.0, np.array([0.3, 0.0, np.radians(100.0)]))
    blind = metrics_of([replace(frame, truth=None) for frame in spun], tmp_path / "blind", OLD)
    assert blind["outcome"] == "unjudged"
    assert blind["self_check"] == lost["self_check"]
    assert blind["result_hash"] == lost["result_hash"]


def test_a_limit_on_the_verdict_is_broken_by_a_lost_run(lost):
    assert Limit.parse("self_check.verdict == lost").broken_by(lost) is not None
    assert Limit.parse("self_check.verdict != plausible").broken_by(lost) is not None
    assert Limit.parse("self_check.contradiction_scans > 1e9").broken_by(lost) is None
    assert Limit.parse("self_check.verdict != plausible").broken_by({"outcome": "ok"}) is not None  # not measured


def found(**changes):
    return {"losses": 0, "lost_at_s": [], "state": "found", "places": 1, "found_after_m": 1.0, **changes}


def test_the_check_of_a_localisation_is_its_status():
    assert localization_self_check(found(error_median_m=9.0), 100.0)["verdict"] == "plausible"
    assert localization_self_check(found(state="ambiguous", places=3), 100.0)["verdict"] == "doubtful"
    assert localization_self_check(found(state="searching"), 100.0)["verdict"] == "lost"
    moved = localization_self_check(found(losses=1, lost_at_s=[7.5]), 100.0)
    assert (moved["verdict"], moved["stamp"], moved["time_s"]) == ("lost", 107.5, 7.5)
