# SPDX-License-Identifier: MIT
"""Files and directories appear whole, or not at all, and leave nothing behind."""

import os
import socket
import subprocess
import sys

import pytest

from eval.files.atomic_write import atomic_directory, atomic_write, create_once, discard_unfinished


def names(folder):
    return sorted(entry.name for entry in folder.iterdir())


def fail_half_way(path, error):
    with atomic_write(path) as temporary:
        temporary.write_text("half")
        raise error


def fill_directory(path, content):
    with atomic_directory(path) as temporary:
        assert temporary.name == path.name
        temporary.mkdir()
        (temporary / "one").write_text(content)
        assert content not in [file.read_text() for file in path.glob("*")]


def fail_in_directory(path):
    with atomic_directory(path) as temporary:
        temporary.mkdir()
        raise ValueError(f"{temporary}/one: wrong")


def test_a_file_is_replaced_at_the_end(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with atomic_write(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert (path.read_text(), names(tmp_path)) == ("new", ["a.txt"])


def test_an_error_keeps_the_old_file_and_names_it(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(OSError, match=r"/a\.txt'$"):
        fail_half_way(path, OSError(28, "no space left on device"))
    assert (path.read_text(), names(tmp_path)) == ("old", ["a.txt"])


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no such directory.*missing'$"):
        fail_half_way(tmp_path / "missing" / "a", ValueError())


def test_a_directory_appears_at_the_end(tmp_path):
    path = tmp_path / "new" / "data"
    fill_directory(path, "1")
    assert (names(path), names(path.parent)) == (["one"], ["data"])


def test_an_error_leaves_no_directory_and_names_it(tmp_path):
    path = tmp_path / "data"
    with pytest.raises(ValueError, match=f"^{path}/one: wrong$"):
        fail_in_directory(path)
    assert names(tmp_path) == []


def test_a_directory_that_came_first_stays(tmp_path):
    path = tmp_path / "data"
    fill_directory(path, "first")
    with pytest.raises(FileExistsError, match=r"/data'$"):
        fill_directory(path, "second")
    assert ((path / "one").read_text(), names(tmp_path)) == ("first", ["data"])


def test_only_the_first_creates_a_file(tmp_path):
    path = tmp_path / "a.txt"
    assert create_once(path, "first")
    assert not create_once(path, "second")
    assert (path.read_text(), names(tmp_path)) == ("first", ["a.txt"])


def test_what_killed_writers_left_is_removed(tmp_path):
    killed = subprocess.Popen([sys.executable, "-c", ""])
    killed.wait()
    host = socket.gethostname()
    running, other_host = f".data.{host}.{os.getppid()}.tmp", f".data.{host}x.{killed.pid}.tmp"
    for name in (f".data.{host}.{killed.pid}.tmp", f".data.{host}.{os.getpid()}.tmp", running, other_host, ".data.tmp"):
        (tmp_path / name).mkdir()
    discard_unfinished(tmp_path / "data")
    assert names(tmp_path) == sorted([running, other_host, ".data.tmp"])
