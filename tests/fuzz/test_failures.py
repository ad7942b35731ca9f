# SPDX-License-Identifier: MIT
"""Every input that fuzzing has found is read, or refused in one line, from then on; so are the sound files."""

from pathlib import Path

import pytest

from tests.fuzz.targets import TARGETS, Target, problem_of

FAILURES = sorted(path for path in (Path(__file__).parent / "failures").iterdir() if path.name != "README")


@pytest.mark.parametrize("failure", FAILURES, ids=lambda path: path.name)
def test_an_input_that_once_failed_no_longer_does(tmp_path, failure):
    target = TARGETS[failure.name.rpartition("-")[0]]
    path = tmp_path / target.file
    path.write_bytes(failure.read_bytes())
    assert problem_of(target, path) is None


@pytest.mark.parametrize("name", TARGETS)
def test_a_sound_file_is_read(tmp_path, name):
    target = TARGETS[name]
    target.write_sound(tmp_path / target.file)
    assert target.read(tmp_path / target.file) is not None


def test_an_error_of_another_kind_is_a_problem(tmp_path):
    def fail(path: Path) -> None:
        raise KeyError(path)

    assert problem_of(Target("x", fail, lambda _: None), tmp_path / "x") is not None
