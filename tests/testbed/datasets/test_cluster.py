# SPDX-License-Identifier: MIT
"""Datasets that a real dask cluster makes."""

import importlib.util
import json

import pytest

from testbed.datasets import open_collection
from tests.shell import call
from tests.testbed.sweep.execution.test_clusters import dask, file_within

COMMON = ("simulate", "loop", "--count", "3", "--duration", "1", "--draw", "noise=0.5..2")


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs the extra `cluster`")
def test_a_cluster_makes_the_same_datasets(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a relative --out must reach the workers, which run elsewhere
    (tmp_path / "worker").mkdir()
    scheduler_file = tmp_path / "scheduler.json"
    quiet = ["--no-dashboard", "--scheduler-file", str(scheduler_file)]
    worker = ["distributed.cli.dask_worker", *quiet, "--nthreads", "1", "--no-nanny"]
    with dask("distributed.cli.dask_scheduler", *quiet, "--port", "0", "--host", "127.0.0.1"):
        address = json.loads(file_within(scheduler_file, 60.0))["address"]
        with dask(*worker, "--local-directory", str(tmp_path / "worker")):
            assert call(*COMMON, "--out", "cluster", "--scheduler", address) == 0
    assert call(*COMMON, "--out", "alone") == 0
    assert len(open_collection("cluster")) == 3
    for dataset in open_collection("alone"):
        for file in dataset.path.iterdir():
            assert (tmp_path / "cluster" / dataset.name / file.name).read_bytes() == file.read_bytes()
