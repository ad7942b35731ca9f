# SPDX-License-Identifier: MIT
"""A disk that is full ends a command with exit status 2 and the name of the file; it never hangs."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from eval.files.atomic_write import atomic_write, create_once
from slam import FilterConfig, GMapping, save_checkpoint
from testbed.formats.write import HOLDS, write_log
from testbed.sweep.spec.plan import Shard
from testbed.sweep.spec.spec import SweepSpec
from testbed.sweep.store import Manifest, SweepDirectory
from tests.shell import TESTBED, call
from tests.testbed.recordings import SUFFIX, two_lidar_drive

TRIES = """
import sys, pathlib
from testbed.views import open_view
from tests.testbed.views.synthetic import scene, snapshots
path = pathlib.Path(sys.argv[1])
for _ in range(50):
    try:
        with open_view(path, scene()) as view:
            for snapshot in snapshots(0.2):
                view.show(snapshot)
    except OSError as error:
        print(error.errno, error.filename)
"""


@pytest.fixture
def small_disk(tmp_path):
    """Mount a disk of a given size; the test is skipped where this user may not."""
    disk = tmp_path / "disk"
    disk.mkdir()
    sized: list[int] = []

    def mount(kilobytes: int) -> Path:
        if shutil.which("mount") is None or os.geteuid() != 0:
            pytest.skip("only root can mount a small disk")
        made = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", disk], check=False)
        if made.returncode != 0:
            pytest.skip("this machine does not let a test mount a disk")
        sized.append(kilobytes)
        return disk

    yield mount
    for _ in sized:
        subprocess.run(["umount", "-l", disk], check=True)


def left(disk: Path) -> list[str]:
    return [str(path.relative_to(disk)) for path in disk.rglob("*")]


@pytest.mark.slow
def test_opening_a_recording_on_a_full_disk_never_hangs(tmp_path):
    """50 tries; rerun's own file sink hung in two of five."""
    if not Path("/dev/full").exists():
        pytest.skip("/dev/full is absent: a file on a full disk cannot be had")
    recording = tmp_path / "recording.rrd"
    recording.symlink_to("/dev/full")
    command = [sys.executable, "-c", TRIES, str(recording)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=True)
    assert done.stdout.splitlines() == [f"{errno.ENOSPC} {recording}"] * 50


@pytest.mark.parametrize("log_format", [name for name in HOLDS if name != "map_server"])
def test_a_recording_that_does_not_fit_is_named_and_removed(small_disk, log_format):
    disk = small_disk(4)
    (disk / "ballast").write_bytes(bytes(4096))
    target = disk / f"drive{SUFFIX.get(log_format, '')}"
    with pytest.raises(OSError, match="space") as raised:
        write_log(target, two_lidar_drive(), log_format)
    assert raised.value.errno == errno.ENOSPC
    assert str(raised.value.filename).startswith(str(target))
    assert left(disk) == ["ballast"]


def test_a_map_is_written_with_its_description_or_not_at_all(small_disk):
    disk = small_disk(8)
    (disk / "ballast").write_bytes(bytes(4096))
    with pytest.raises(OSError, match="space"):
        write_log(disk / "map.yaml", two_lidar_drive(), "map_server")
    assert left(disk) == ["ballast"]


def test_what_a_copy_does_not_fit_into_is_named(small_disk, tmp_path):
    """The system names what is copied first."""
    source = tmp_path / "large"
    source.write_bytes(bytes(100_000))
    disk = small_disk(8)
    with pytest.raises(OSError, match="space") as raised, atomic_write(disk / "copy") as temporary:
        shutil.copyfile(source, temporary)
    assert raised.value.filename == str(disk / "copy")
    assert left(disk) == []


def test_a_file_that_is_made_once_is_named_and_removed(small_disk):
    disk = small_disk(4)
    (disk / "ballast").write_bytes(bytes(4096))
    with pytest.raises(OSError, match="space") as raised:
        create_once(disk / "once", "text")
    assert raised.value.filename == str(disk / "once")
    assert left(disk) == ["ballast"]


@pytest.mark.parametrize("shard", [None, Shard(0, 2)])
def test_the_lock_of_a_sweep_that_does_not_fit_is_named(small_disk, shard):
    disk = small_disk(4)
    (disk / "ballast").write_bytes(bytes(4096))
    manifest = Manifest(SweepSpec(worlds=("loop",)), code="0" * 16, inputs={})
    with pytest.raises(OSError, match="space") as raised, SweepDirectory(disk, manifest).locked(shard):
        pass
    assert raised.value.filename.startswith(str(disk / ".lock"))


def test_a_checkpoint_that_does_not_fit_is_named_and_removed(small_disk):
    disk = small_disk(4)
    with pytest.raises(OSError, match=r"space.*filter\.npz'$"):
        save_checkpoint(GMapping(FilterConfig(particles=200)), disk / "filter.npz")
    assert left(disk) == []
    with pytest.raises(FileNotFoundError, match=r"/filter\.npz'$"):
        save_checkpoint(GMapping(FilterConfig(particles=2)), disk / "absent" / "filter.npz")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a dataset and a run."""
    folder = tmp_path_factory.mktemp("made")
    drive = ["loop", "--duration", "3", "--backend", "fast"]
    assert call("simulate", *drive, "--out", folder / "data") == 0
    assert call("run", *drive, "--particles", "2", "--out", folder / "run") == 0
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        "slam {made}/data/loop-0000 --particles 2 --out {disk}/out",
        "convert {made}/data/loop-0000 {disk}/out --to rosbag2-sqlite",
        "convert {made}/data/loop-0000 {disk}/out.log.gz --to carmen",
        "perturb {made}/data/loop-0000 {disk}/out --drop-scans 0.2",
        "stress odometry --worlds loop --perturbations slip --seeds 1 --duration 3 --workers 1 --out {disk}/out",
        "score {made}/run --trajectory {made}/run/filter.tum --map {made}/run/map.yaml --out {disk}/out",
        "report {made}/run {made}/run --out {disk}/both.html",
        "worlds generate maze --seed 7 --out {disk}/maze.toml",
        "worlds show loop --out {disk}/loop.png",
        "worlds import {made}/run/map.yaml --out {disk}/floor.toml",
        "view {made}/run --save {disk}/run.rrd",
        "view {made}/run --time 1 --save {disk}/run.png",
        "view {made}/data/loop-0000 --save {disk}/data.rrd",
        "twin {made}/data/loop-0000 --particles 2 --out {disk}/twin",
    ],
)
def test_whatever_is_written_the_file_that_does_not_fit_is_named(small_disk, made, capsys, command):
    disk = small_disk(4)
    capsys.readouterr()
    assert call(*command.format(made=made, disk=disk).split()) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"testbed: {disk}/")
    assert last.endswith("no space left on the disk")


@pytest.mark.slow
@pytest.mark.parametrize("kilobytes", [8, 100, 400])
@pytest.mark.parametrize(
    "command",
    [
        "run loop --duration 5 --particles 2 --backend fast --out {0}/out",
        "simulate loop --duration 20 --backend fast --out {0}/out",
        "simulate loop --duration 20 --backend fast --format parquet --out {0}/out",
        "sweep --worlds loop --particles 1 --seeds 2 --workers 1 --set duration=5 --out {0}/out",
    ],
)
def test_a_command_on_a_full_disk_is_one_line_and_exit_2(small_disk, kilobytes, command):
    disk = small_disk(kilobytes)
    words = [*TESTBED, *command.format(disk).split()]
    done = subprocess.run(words, capture_output=True, text=True, timeout=250, check=False)
    assert done.returncode == 2, done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"testbed: {disk}")
    assert last.endswith("no space left on the disk")
    assert "Traceback" not in done.stderr
    assert not any(path.name == "report.html" for path in disk.rglob("*"))
