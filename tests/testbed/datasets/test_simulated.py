# SPDX-License-Identifier: MIT
"""Synthetic datasets: the same bytes again, whole or not there, and changes are noticed."""

import os
import signal
import socket
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from eval.files.atomic_write import discard_unfinished
from eval.files.map_server import read_map
from eval.files.tum import read_tum
from testbed.datasets import simulated as dataset
from testbed.datasets.index import datasets_in
from testbed.datasets.simulated import is_complete, write_dataset
from testbed.formats import LogError, open_log
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig
from tests.shell import AT_A_TERMINAL, TESTBED, call
from worlds import load

CONFIG = SimulationConfig(
    robot=load_robot("create3"),
    lidar=load_lidar("rplidar_a2"),
    backend="fast",
    duration=1.5,
    seeds=RunSeeds.from_seed(3),
)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("datasets") / "loop"
    write_dataset(path, load("loop"), CONFIG, {"seed": 3})
    return path


def copy(made: Path, to: Path) -> Path:
    to.mkdir()
    for file in made.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


def test_a_dataset_holds_recording_truth_map_and_settings(made):
    log = open_log(made)
    truth = read_tum(made / "truth.tum")
    scans = [frame for frame in log.frames if frame.scan is not None]
    np.testing.assert_allclose(truth.stamps, [frame.stamp for frame in scans])
    np.testing.assert_allclose(truth.poses, [frame.truth for frame in scans], atol=1e-9)
    assert read_map(made / "truth_map.yaml").occupied.any()
    assert load(made / "world.toml").name == "loop"
    assert tomllib.loads((made / "config.toml").read_text())["settings"] == {"seed": 3}


@pytest.mark.parametrize("log_format", ["rosbag2", "rosbag2-lean", "carmen"])
def test_the_same_settings_give_the_same_bytes(tmp_path, log_format):
    for parent in ("a", "b"):
        write_dataset(tmp_path / parent / "loop", load("loop"), CONFIG, {}, log_format=log_format)
    names = sorted(path.name for path in (tmp_path / "a" / "loop").iterdir())
    for name in names:
        assert (tmp_path / "a" / "loop" / name).read_bytes() == (tmp_path / "b" / "loop" / name).read_bytes(), name
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["loop"]


@pytest.mark.parametrize("name", ["loop.mcap", "metadata.yaml", "world.toml", "truth.tum", "truth_map.pgm"])
def test_any_changed_or_missing_file_is_named(made, tmp_path, name):
    damaged = copy(made, tmp_path / "loop")
    content = bytearray((damaged / name).read_bytes())
    content[len(content) // 2] ^= 1
    (damaged / name).write_bytes(content)
    with pytest.raises(LogError, match=f"{name}: has changed"):
        open_log(damaged)
    if name != "metadata.yaml":  # without it the directory is no bag at all
        (damaged / name).unlink()
        with pytest.raises(LogError, match=f"{name}: missing"):
            open_log(damaged)


@pytest.mark.parametrize(
    "text", ["[checksums]\n'../loop.mcap' = ''\n", "checksums = 3\n", "checksums = \n", "[" * 5000]
)
def test_a_strange_config_is_refused(made, tmp_path, text):
    strange = copy(made, tmp_path / "loop")
    (strange / "config.toml").write_text(text)
    with pytest.raises(LogError, match=r"config\.toml: "):
        open_log(strange)


def test_a_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(dataset, "write_map", full)
    with pytest.raises(OSError, match="No space"):
        write_dataset(tmp_path / "loop", load("loop"), CONFIG, {})
    assert list(tmp_path.iterdir()) == []
    assert not is_complete(tmp_path / "loop")


def simulate(out: Path, *options: str) -> int:
    return call("simulate", "loop", "--out", out, "--duration", "0.5", *options)


def test_a_job_that_was_cut_off_goes_on_where_it_was(tmp_path, capsys):
    assert simulate(tmp_path, "--count", "2") == 0
    first = tmp_path / "loop-0000" / "config.toml"
    written = first.stat().st_mtime_ns
    killed = subprocess.Popen([sys.executable, "-c", ""])
    killed.wait()
    (tmp_path / f".loop-0002.{socket.gethostname()}.{killed.pid}.tmp").mkdir()  # as a kill leaves it
    assert simulate(tmp_path, "--count", "3", "--workers", "2") == 0
    assert "wrote 1 dataset; 2 existed already and were kept" in capsys.readouterr().out
    assert first.stat().st_mtime_ns == written
    assert [path.name for path in datasets_in(tmp_path)] == ["loop-0000", "loop-0001", "loop-0002"]


def test_ctrl_c_ends_soon_and_leaves_whole_datasets_only(tmp_path):
    command = [*AT_A_TERMINAL, "simulate", "office", "--count", "3"]
    job = subprocess.Popen([*command, "--out", tmp_path], stderr=subprocess.PIPE, text=True, start_new_session=True)
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob(".office-0000.*.tmp")):  # a worker is at work
        assert time.monotonic() < deadline
        assert job.poll() is None
        time.sleep(0.05)
    os.killpg(job.pid, signal.SIGINT)  # as a terminal does: to all
    _, errors = job.communicate(timeout=30)
    assert (job.returncode, errors.splitlines()[-1]) == (130, "testbed: interrupted")
    assert "Traceback" not in errors
    assert all((path / "config.toml").is_file() for path in tmp_path.iterdir())


def test_other_files_are_left_alone(tmp_path, capsys):
    (tmp_path / "loop-0000").mkdir()
    (tmp_path / "loop-0000" / "thesis.tex").write_text("years of work")
    assert simulate(tmp_path) == 2
    assert "loop-0000: exists and is no dataset" in capsys.readouterr().err
    assert simulate(tmp_path, "--count", "0") == 2


def test_a_worker_that_outlived_its_parent_is_let_be(tmp_path):
    """It writes beside the one that was started again, and whoever is first wins."""
    path, content = tmp_path / "loop", {}
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as outlived:
        others = tmp_path / f".loop.{socket.gethostname()}.{outlived.pid}.tmp" / "loop"
        others.mkdir(parents=True)
        write_dataset(path, load("loop"), CONFIG, {})
        assert others.exists()
        content = {file.name: file.read_bytes() for file in path.iterdir()}
        write_dataset(path, load("loop"), CONFIG, {})
        assert {file.name: file.read_bytes() for file in path.iterdir()} == content
        outlived.stdin.close()
    discard_unfinished(path)
    assert [left.name for left in tmp_path.iterdir()] == ["loop"]


@pytest.mark.slow
def test_a_killed_job_continues_to_the_same_bytes(tmp_path):
    command = [*TESTBED, "simulate", "apartment", "--duration", "8"]
    job = subprocess.Popen([*command, "--count", "4", "--workers", "2", "--out", tmp_path / "a"])
    deadline = time.monotonic() + 120
    while not list((tmp_path / "a").glob("apartment-*")):  # one is whole, others are at work
        assert time.monotonic() < deadline
        assert job.poll() is None
        time.sleep(0.02)
    workers = Path(f"/proc/{job.pid}/task/{job.pid}/children").read_text().split()
    job.kill()
    job.wait()
    while any(Path(f"/proc/{worker}").exists() for worker in workers):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    subprocess.run([*command, "--count", "4", "--workers", "2", "--out", tmp_path / "a"], check=True)
    names = [f"apartment-{k:04d}" for k in range(4)]
    assert [path.name for path in datasets_in(tmp_path / "a")] == names
    again = tmp_path / "a" / names[2] / "config.toml"
    subprocess.run([*command[:-3], "--config", again, "--out", tmp_path / "b"], check=True)
    for file in again.parent.iterdir():
        assert file.read_bytes() == (tmp_path / "b" / names[2] / file.name).read_bytes()


def test_a_map_that_names_a_picture_elsewhere_is_refused(made, tmp_path):
    leading_out = copy(made, tmp_path / "loop")
    (leading_out / "config.toml").unlink()  # whoever makes such a dataset makes the check sums fit
    text = (leading_out / "truth_map.yaml").read_text()
    (tmp_path / "secret.pgm").write_bytes((leading_out / "truth_map.pgm").read_bytes())
    (leading_out / "truth_map.yaml").write_text(text.replace("truth_map.pgm", "../secret.pgm"))
    with pytest.raises(ValueError, match="lies outside of the map's folder"):
        read_map(leading_out / "truth_map.yaml", inside=True)
