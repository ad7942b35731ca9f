# SPDX-License-Identifier: MIT
"""Where compiled kernels are kept: only where nobody else can put a file that numba would run."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from slam._kernel_cache import cache_folder

NOBODY = 65534
USE_A_KERNEL = """
import numpy as np
from slam._planar_kernels import cholesky
assert cholesky(np.eye(3), np.empty((3, 3)))
print(cholesky.stats.cache_hits)
"""


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A package, the usual root, and the root in the folder for temporary files."""
    package, usual, temporary = (tmp_path / name for name in ("package", "usual", "temporary"))
    package.mkdir()
    (package / "_a_kernels.py").write_text("A = 1\n")
    temporary.mkdir()
    monkeypatch.setenv("TESTBED_CACHE", str(usual))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(temporary))
    cache_folder.cache_clear()
    yield package, usual, temporary / f"slam-testbed-{os.getuid()}"
    cache_folder.cache_clear()


def found(package) -> Path | None:
    cache_folder.cache_clear()
    return cache_folder(package)


def test_the_usual_place_is_made_for_this_user_alone(folders):
    package, usual, _ = folders
    folder = found(package)
    assert folder is not None
    assert folder.parents[1] == usual
    assert {place.stat().st_mode & 0o777 for place in (usual, usual / "kernels", folder)} == {0o700}


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_folder_that_others_can_write_is_not_used(folders, level):
    package, _, temporary = folders
    place = (folder := found(package), *folder.parents)[level]
    place.chmod(0o777)
    assert found(package).parents[1] == temporary
    place.chmod(0o775)  # by the group
    assert found(package).parents[1] == temporary


def test_a_place_like_tmp_holds_a_folder_of_our_own(folders):
    package, usual, _ = folders
    usual.mkdir()
    usual.chmod(0o1777)
    assert found(package).parents[1] == usual


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder to another user")
@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_folder_that_another_user_has_planted_is_not_used(folders, level, caplog):
    package, _, temporary = folders
    place = (folder := found(package), *folder.parents)[level]
    os.chown(place, NOBODY, NOBODY)
    assert found(package).parents[1] == temporary
    os.chown(temporary, NOBODY, NOBODY)
    assert found(package) is None
    (line,) = caplog.messages
    assert f"{place} belongs to another user" in line
    assert str(temporary) in line


def kept(folder: Path) -> Path:
    """A file as numba keeps it, in a folder of its own."""
    inner = folder / "slam_1234"
    inner.mkdir()
    file = inner / "kernel.nbi"
    file.write_bytes(b"")
    return file


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a file to another user")
def test_a_file_of_another_user_in_a_folder_of_ours_is_not_used(folders, caplog):
    """As from when the folder could be written by others."""
    package, _, temporary = folders
    file = kept(found(package))
    os.chown(file, NOBODY, NOBODY)
    assert found(package).parents[1] == temporary
    shutil.rmtree(temporary)
    temporary.write_text("a file")
    assert found(package) is None
    assert f"{file} belongs to another user" in caplog.text


def test_a_file_that_others_can_write_is_not_used_where_they_can_enter(folders):
    package, usual, temporary = folders
    folder = found(package)
    file = kept(folder)
    for place, closed in ((file, 0o644), (file.parent, 0o755)):
        place.chmod(0o775)  # as with the umask of many systems, 002
        folder.chmod(0o755)
        assert found(package).parents[1] == temporary
        folder.chmod(0o700)
        assert found(package).parents[1] == usual
        place.chmod(closed)
        folder.chmod(0o755)
        assert found(package).parents[1] == usual


def test_a_link_to_a_folder_elsewhere_is_not_followed(folders, tmp_path):
    package, _, temporary = folders
    folder = found(package)
    shutil.rmtree(folder)
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    assert found(package).parents[1] == temporary


def test_without_any_place_there_is_one_line(folders, caplog):
    package, usual, temporary = folders
    usual.write_text("a file")
    temporary.write_text("a file")
    assert found(package) is None
    assert len(caplog.messages) == 1


def test_a_complete_folder_that_cannot_be_written_is_copied_once(folders, monkeypatch):
    package, usual, temporary = folders
    folder = found(package)
    for name in ("kernel.nbc", "compiled-1"):
        (folder / name).write_text(name)
    able = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: usual not in Path(path).parents and able(path, mode))
    copy = found(package)
    assert copy.parents[1] == temporary
    assert (copy / "kernel.nbc").read_text() == "kernel.nbc"
    (copy / "kernel.nbc").write_text("changed")
    assert (found(package) / "kernel.nbc").read_text() == "changed"


def run_kernel(root: Path, **settings) -> subprocess.CompletedProcess:
    environment = os.environ | {"TESTBED_CACHE": str(root), "SLAM_KERNEL_CACHE": "1"}
    return subprocess.run(
        [sys.executable, "-c", USE_A_KERNEL], env=environment, capture_output=True, text=True, check=True, **settings
    )


@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
def test_damaged_machine_code_is_compiled_again_once(tmp_path, kind):
    run_kernel(tmp_path)
    for file in tmp_path.rglob(kind):
        file.write_bytes(b"\x80\x04garbage")
    again = run_kernel(tmp_path)
    (line,) = again.stderr.splitlines()
    assert "damaged machine code, compiled again" in line
    after = run_kernel(tmp_path)
    assert after.stderr == ""
    assert "1" in after.stdout


@pytest.mark.skipif(os.getuid() != 0, reason="only root can run a program as another user")
def test_a_cache_that_root_has_warmed_serves_another_user():
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        root.chmod(0o755)
        run_kernel(root)
        for place in (root, *root.rglob("*")):
            place.chmod(0o755 if place.is_dir() else 0o644)
        package = next((root / "kernels").glob("slam-*"))
        (package / "compiled-by-root").touch()
        try:
            settings = {"user": NOBODY, "group": NOBODY, "extra_groups": [], "cwd": Path(__file__).parents[2]}
            done = run_kernel(root, **settings)
        except PermissionError:
            pytest.skip("another user cannot read this installation of Python")
        finally:
            shutil.rmtree(Path(tempfile.gettempdir()) / f"slam-testbed-{NOBODY}", ignore_errors=True)
        assert done.stderr == ""
        assert "1" in done.stdout
