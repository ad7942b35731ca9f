# SPDX-License-Identifier: MIT
"""Compilation ahead of the first run: told whenever it is due, cut off without a trace of being done."""

import fcntl
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from slam._jit import top_package
from testbed import kernels
from tests.shell import AT_A_TERMINAL


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with one kernel file, and a cache of its own."""
    monkeypatch.setenv("TESTBED_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("SLAM_KERNEL_CACHE", raising=False)
    kernels.cache_folder.cache_clear()
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "_a_kernels.py").write_text("A = 1\n")
    monkeypatch.setattr(kernels, "PACKAGES", (folder,))
    yield folder
    kernels.cache_folder.cache_clear()


def test_some_machine_code_on_disk_is_not_all_of_it(package):
    (kernels.cache_folder(package) / "kernel.nbc").write_bytes(b"of a compilation that was cut off")
    assert not kernels.is_compiled()


def test_changed_kernels_do_not_count_as_compiled(package):
    kernels._mark(package).touch()
    assert kernels.is_compiled()
    os.utime(package / "_a_kernels.py", (1.0, 1.0))  # numba compiles again for another time of change
    assert not kernels.is_compiled()


def test_a_second_installation_is_compiled_too(package, tmp_path, monkeypatch):
    kernels._mark(package).touch()
    other = tmp_path / "elsewhere" / "package"
    other.mkdir(parents=True)
    source = package / "_a_kernels.py"
    (other / source.name).write_bytes(source.read_bytes())
    os.utime(other / source.name, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
    monkeypatch.setattr(kernels, "PACKAGES", (other,))
    assert kernels.cache_folder(other) == kernels.cache_folder(package)
    assert not kernels.is_compiled()


def test_without_a_cache_on_disk_there_is_nothing_to_announce(package, monkeypatch):
    monkeypatch.setenv("SLAM_KERNEL_CACHE", "0")
    assert kernels.is_compiled()


def test_a_second_process_waits_for_the_first_one(package, monkeypatch):
    """It says how far the first one is, and compiles nothing itself where that has compiled all."""
    monkeypatch.setattr(kernels, "PERIOD", 0.01)
    monkeypatch.setattr(sys, "executable", "/bin/false")
    told: list[tuple[int, int]] = []
    first = (kernels.cache_folder(package) / "compiling").open("a")
    fcntl.flock(first, fcntl.LOCK_EX)

    def news(done: int, total: int) -> None:
        told.append((done, total))
        if len(told) == 3:
            kernels._mark(package).touch()
            first.close()

    kernels.compile_kernels(news)
    assert len(told) == 3


def test_a_failure_is_one_line(package, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(OSError, match="could not be compiled: exit status 1"):
        kernels.compile_kernels()


def test_a_failure_of_one_process_ends_the_other(package, tmp_path, monkeypatch):
    process = tmp_path / "process"
    process.write_text(f'#!/bin/sh\n[ "$3" = rest ] && exit 1\necho $$ > {tmp_path}/pid\nexec sleep 60\n')
    process.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(process))
    monkeypatch.setattr(kernels, "core_count", lambda: 2)
    monkeypatch.setattr(kernels, "PERIOD", 0.2)
    with pytest.raises(OSError, match="could not be compiled"):
        kernels.compile_kernels()
    if (tmp_path / "pid").exists():  # it may have been ended before it wrote that
        with pytest.raises(ProcessLookupError):
            os.kill(int((tmp_path / "pid").read_text()), 0)
    assert not kernels.is_compiled()


@pytest.mark.parametrize("cores", [1, 2, 8])
def test_every_part_is_compiled_once(cores, monkeypatch):
    monkeypatch.setattr(kernels, "core_count", lambda: cores)
    shares = kernels._shares()
    assert sorted(part for share in shares for part in share) == sorted(kernels.PARTS)
    assert len(shares) == min(cores, 2)


def test_ctrl_c_while_compiling_ends_soon_and_marks_the_run(tmp_path):
    command = [*AT_A_TERMINAL, "run", "loop", "--out", "run"]
    with (tmp_path / "errors").open("w") as errors:
        run = subprocess.Popen(
            command,
            stderr=errors,
            cwd=tmp_path,
            env=os.environ | {"TESTBED_CACHE": str(tmp_path / "cache"), "SLAM_KERNEL_CACHE": "1"},
            start_new_session=True,
        )
    deadline = time.monotonic() + 60
    while "Compiling" not in (tmp_path / "errors").read_text():
        assert time.monotonic() < deadline
        assert run.poll() is None
        time.sleep(0.05)
    time.sleep(1.0)  # now the other process is at work
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does: to both
    assert run.wait(30) == 130
    said = (tmp_path / "errors").read_text().splitlines()
    assert said[-1] == "testbed: interrupted"
    assert not any("Traceback" in line for line in said)
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["outcome"] == "interrupted"


UNCOMPILED = """
import importlib, numba
from slam._kernel_cache import kernel_files
from slam._jit import top_package
from testbed import kernels
kernels.exercise_kernels()
for package in kernels.PACKAGES:
    for file in kernel_files(package):
        module = importlib.import_module(".".join(file.relative_to(package.parent).with_suffix("").parts))
        for name, value in vars(module).items():
            if not isinstance(value, numba.core.dispatcher.Dispatcher) or value.targetoptions.get("forceinline"):
                continue
            if value.py_func.__module__ == module.__name__ and not value.signatures:
                print(module.__name__, name, "is not compiled")
            if any("raise_with_shape_context" in code for code in value.inspect_llvm().values()):
                print(module.__name__, name, "assigns an array to a part of another, which takes long to compile")
"""
"""Prints every kernel that the warm-up leaves uncompiled, and every one that takes long for no reason; a cold cache,
since a cached caller compiles no callee."""


@pytest.mark.slow
def test_warming_up_compiles_every_kernel(tmp_path):
    environment = os.environ | {"TESTBED_CACHE": str(tmp_path), "SLAM_KERNEL_CACHE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", UNCOMPILED], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == ""


def test_a_change_of_any_kernel_file_at_any_depth_changes_the_folder(package):
    before = kernels.cache_folder(package)
    (package / "below" / "deeper").mkdir(parents=True)
    (package / "below" / "deeper" / "_b_kernels.py").write_text("B = 1\n")
    kernels.cache_folder.cache_clear()
    between = kernels.cache_folder(package)
    (package / "below" / "deeper" / "_b_kernels.py").write_text("B = 2\n")
    kernels.cache_folder.cache_clear()
    assert len({before, between, kernels.cache_folder(package)}) == 3


def test_the_package_of_a_kernel_is_the_outermost(tmp_path):
    inner = tmp_path / "outer" / "inner"
    inner.mkdir(parents=True)
    for folder in (inner, inner.parent):
        (folder / "__init__.py").touch()
    assert top_package(inner / "_a_kernels.py") == inner.parent
