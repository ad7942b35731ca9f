# SPDX-License-Identifier: MIT
"""A run tells its three estimates apart: in its files, and by the same measures in metrics.json."""

import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

from eval.consistency import path_nees
from eval.files.run_reader import RunFilesError, read_run
from eval.files.tum import read_tum
from eval.report.run_report import write_report
from eval.scoring import Reference, score
from slam.config import FilterConfig
from testbed.cli.shared.console import progress_line
from testbed.run.execute import execute_job
from testbed.run.job import Job, RecordedFrames
from testbed.run.run_directory import RunDirectory
from testbed.simulation import SimulationConfig, simulate
from testbed.systems.filter_system import FilterSystem
from testbed.views import NullView
from worlds import load


class Reported(NullView):
    """Keeps the pose that the filter reported at each scan."""

    def __init__(self) -> None:
        self.poses = []

    def show(self, snapshot) -> None:
        self.poses.append(snapshot.estimate)


@pytest.fixture(scope="module")
def frames():
    config = SimulationConfig(backend="fast", duration=30.0)
    with simulate(load("apartment"), config) as simulation:
        return list(simulation)


def carried_out(frames, folder, *, refine):
    job = Job(
        source=RecordedFrames(frames),
        document={},
        seed=0,
        system=FilterSystem(FilterConfig(particles=3), refine=refine, threads=None),
    )
    reported = Reported()
    with progress_line() as watcher:
        execute_job(job, RunDirectory.create(folder), watcher, reported)
    return json.loads((folder / "metrics.json").read_text()), reported.poses


@pytest.fixture(scope="module")
def refined(frames, tmp_path_factory):
    """The directory of a run with the final pass, its metrics and the poses that it reported; to be read only."""
    folder = tmp_path_factory.mktemp("refined") / "run"
    return folder, *carried_out(frames, folder, refine=True)


@pytest.fixture(scope="module")
def filtered(frames, tmp_path_factory):
    """The directory of a run without the final pass, and its metrics; to be read only."""
    folder = tmp_path_factory.mktemp("filtered") / "run"
    return folder, carried_out(frames, folder, refine=False)[0]


def keys_of(metrics):
    return {key: keys_of(value) if isinstance(value, dict) else None for key, value in metrics.items()}


def test_the_three_estimates_are_written_and_scored_alike(refined):
    run, metrics, reported = refined
    assert metrics["refined"] is True
    expected = keys_of(metrics["trajectory"])
    del expected["odometry"]
    assert keys_of(metrics["trajectory_online"]) == keys_of(metrics["trajectory_filter"]) == expected
    assert keys_of(metrics["map_filter"]) == keys_of(metrics["map"])
    np.testing.assert_allclose(read_tum(run / "online.tum").poses, reported, atol=1e-6)
    truth = read_tum(run / "truth.tum")
    for name, file in (("trajectory_online", "online"), ("trajectory_filter", "filter"), ("trajectory", "estimate")):
        again = score(read_tum(run / f"{file}.tum"), reference=Reference(trajectory=truth))
        assert metrics[name]["ate_rmse_m"] == pytest.approx(again["trajectory"]["ate_rmse_m"], rel=1e-3)
    errors = [metrics[name]["ate_rmse_m"] for name in ("trajectory_online", "trajectory_filter", "trajectory")]
    assert len(set(errors)) == 3


def test_without_a_final_pass_the_estimate_is_the_filters(filtered):
    _, metrics = filtered
    assert metrics["refined"] is False
    assert metrics["map_filter"] == metrics["map"]
    assert metrics["outcome_filter"] == metrics["outcome"]
    assert metrics["trajectory_filter"]["ate_rmse_m"] == metrics["trajectory"]["ate_rmse_m"]
    assert metrics["trajectory_online"]["ate_rmse_m"] != metrics["trajectory"]["ate_rmse_m"]


@pytest.mark.usefixtures("without_pictures")
def test_covariances_have_a_row_for_each_pose_and_are_judged_by_the_truth(refined, tmp_path):
    folder, metrics, _ = refined
    shutil.copytree(folder, tmp_path / "run")
    run = read_run(folder)
    assert run.covariances.shape == (len(run.estimate.stamps), 3, 3)
    largest = np.sqrt(np.linalg.eigvalsh(run.covariances[:, :2, :2])[:, -1].max())
    assert metrics["covariance"]["sigma_position_max_m"] == pytest.approx(largest, rel=0.02)  # that is of all frames
    nees = path_nees(run.estimate.poses, run.truth.poses, run.covariances)
    assert metrics["covariance"]["nees_mean"] == pytest.approx(np.nanmean(nees), rel=0.3)
    write_report(tmp_path / "run")
    assert "How far the final path may err" in (tmp_path / "run" / "report.html").read_text()


def test_without_a_final_pass_there_are_no_covariances(filtered):
    folder, metrics = filtered
    assert "covariance" not in metrics
    assert read_run(folder).covariances is None


def test_a_table_of_covariances_without_a_column_is_named(refined, tmp_path):
    shutil.copytree(refined[0], tmp_path / "run")
    path = tmp_path / "run" / "estimate_covariance.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["cov_xt"]), path)
    with pytest.raises(RunFilesError, match=r"estimate_covariance\.parquet: expected a column 'cov_xt'"):
        read_run(tmp_path / "run")
