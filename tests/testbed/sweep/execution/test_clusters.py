# SPDX-License-Identifier: MIT
"""Clusters: the example jobs as a scheduler would start them, and a real dask cluster that loses a worker."""

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from testbed.cli.shared.app import app
from tests.shell import TESTBED
from tests.testbed.sweep.room import room_file
from tests.testbed.sweep.test_sweep import bytes_of, call, children_of

pytestmark = pytest.mark.slow
JOBS = Path(__file__).parents[4] / "docs" / "jobs"
SPEC = """
worlds = ["room.toml"]
seeds = 3
particles = [1, 3]
settings.refine = false
axes."filter.proposal.kind" = ["improved", "motion"]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A place with study.toml, its world, and `testbed` on the PATH."""
    folder = tmp_path_factory.mktemp("cluster")
    room_file(folder)
    (folder / "study.toml").write_text(SPEC)
    program = folder / "bin" / "testbed"
    program.parent.mkdir()
    program.write_text(f"#!{TESTBED[0]}\n{TESTBED[-1]}\n")
    program.chmod(0o755)
    return folder


@pytest.fixture(scope="module")
def single(folder) -> dict[str, bytes]:
    """What the sweep gives in one go."""
    assert call("sweep", folder / "study.toml", "--no-worst", "--out", folder / "single") == 0
    return bytes_of(folder / "single")


def run_parts(folder: Path, parts: list[tuple[list[str], dict[str, str]]]) -> None:
    """Run commands with their environments in `folder`, four at a time; each must succeed."""
    path = {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}"}

    def run(part: tuple[list[str], dict[str, str]]) -> None:
        subprocess.run(part[0], cwd=folder, env=os.environ | path | part[1], check=True, capture_output=True)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(run, parts))


def test_the_slurm_job_gives_the_bytes_of_the_single_sweep(folder, single):
    script = (JOBS / "slurm.sh").read_text()
    (last,) = re.findall(r"^#SBATCH --array=0-(\d+)$", script, flags=re.MULTILINE)
    assert int(last) == 7
    run_parts(folder, [slurm("slurm.sh", index, 3, OUT="slurm") for index in range(3)])
    assert call("gather", folder / "slurm", "--no-worst") == 0
    assert bytes_of(folder / "slurm") == single


def slurm(script: str, index: int, count: int, **variables: str) -> tuple[list[str], dict[str, str]]:
    """The command of one part of an array, and its environment."""
    cache = os.environ.get("TESTBED_CACHE", str(Path.home() / ".cache" / "slam-testbed"))
    task = {"SLURM_ARRAY_TASK_ID": str(index), "SLURM_ARRAY_TASK_COUNT": str(count), "SLURM_CPUS_PER_TASK": "1"}
    return ["bash", str(JOBS / script)], task | {"TESTBED_CACHE": cache} | variables


def test_the_slurm_jobs_of_datasets_make_all_of_them(folder):
    variables = {"WORLDS": "room.toml", "COUNT": "3", "OUT": "data"}
    run_parts(folder, [slurm("slurm_simulate.sh", index, 2, **variables) for index in range(2)])
    assert call("datasets", "index", folder / "data") == 0
    assert sorted(path.name for path in (folder / "data").glob("room-*")) == ["room-0000", "room-0001", "room-0002"]
    assert (folder / "data" / "datasets.parquet").is_file()


def test_the_slurm_jobs_of_a_stress_test_turn_up_one_perturbation_each(folder):
    variables = {"SYSTEMS": "odometry", "WORLDS": "room.toml", "PERTURBATIONS": "slip drop-scans", "OUT": "stress"}
    short = {"SEEDS": "1", "DURATION": "5"}
    run_parts(folder, [slurm("slurm_stress.sh", index, 2, **variables, **short) for index in range(2)])
    for name in ("slip", "drop-scans"):
        assert name in (folder / "stress" / name / "table.md").read_text()


@pytest.mark.parametrize("path", sorted(JOBS.glob("*.yaml")), ids=lambda path: path.name)
def test_the_kubernetes_jobs_call_commands_and_options_that_exist(path):
    job = yaml.safe_load(path.read_text())["spec"]
    (container,) = job["template"]["spec"]["containers"]
    program, command, *words = [*container["command"], *container["args"]]
    assert program == "testbed"
    known = {name for argument in app[command].assemble_argument_collection() for name in argument.names}
    assert {word for word in words if word.startswith("--")} <= known


def test_the_kubernetes_job_gives_the_bytes_of_the_single_sweep(folder, single):
    job = yaml.safe_load((JOBS / "kubernetes.yaml").read_text())["spec"]
    (container,) = job["template"]["spec"]["containers"]
    assert job["completionMode"] == "Indexed"
    words = [*container["command"], *container["args"]]
    words[words.index("--out") + 1] = "kubernetes"
    words[words.index("--workers") + 1] = "1"
    words[words.index("/work/study.toml")] = "study.toml"
    pods = [[word.replace("$(JOB_COMPLETION_INDEX)", str(k)) for word in words] for k in range(job["completions"])]
    run_parts(folder, [(pod, {}) for pod in pods])
    assert call("gather", folder / "kubernetes", "--no-worst") == 0
    assert bytes_of(folder / "kubernetes") == single


@contextmanager
def dask(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process of dask's command line."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = subprocess.Popen(
        [sys.executable, "-m", *arguments], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env=environment
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def file_within(path: Path, seconds: float) -> str:
    """Content of a file once it is there and whole."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if path.is_file() and (text := path.read_text()).rstrip().endswith("}"):
            return text
        time.sleep(0.05)
    raise AssertionError(f"{path} did not appear")


@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs the extra `cluster`")
def test_a_cluster_that_loses_a_worker_gives_equal_bytes(folder, single):
    scheduler_file = folder / "scheduler.json"
    quiet = ["--no-dashboard", "--scheduler-file", str(scheduler_file)]
    worker = ["distributed.cli.dask_worker", *quiet, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
    with dask("distributed.cli.dask_scheduler", *quiet, "--port", "0", "--host", "127.0.0.1"):
        address = json.loads(file_within(scheduler_file, 60.0))["address"]
        with dask(*worker) as first, dask(*worker):
            out = folder / "dask"
            arguments = ["sweep", "study.toml", "--no-worst", "--scheduler", address, "--out", str(out)]
            sweep = subprocess.Popen([str(folder / "bin" / "testbed"), *arguments], cwd=folder)
            deadline = time.monotonic() + 100.0
            while not children_of(first.pid) and time.monotonic() < deadline:
                time.sleep(0.01)
            assert children_of(first.pid), "the worker was given no cell"
            first.send_signal(signal.SIGKILL)  # while it computes its first cell
            assert sweep.wait(timeout=100.0) == 0
    assert bytes_of(out) == single
