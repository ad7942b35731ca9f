# SPDX-License-Identifier: MIT
"""`testbed view` opens a run at the right moment."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import SimpleNamespace

import pytest

from eval.files.run_reader import read_run
from tests.eval.synthetic_run import write_run

command = importlib.import_module("testbed.cli.view")


@pytest.fixture
def moments(monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    """Where the viewer was opened; no viewer is started."""
    opened: list[float | None] = []

    def open_run(run: Path, *, serve: bool, moment: float | None) -> SimpleNamespace:
        opened.append(moment)
        return SimpleNamespace(address=None, wait=lambda: None)

    monkeypatch.setattr(command, "open_run", open_run)
    return opened


def test_a_run_that_went_wrong_opens_at_its_moment(tmp_path: Path, moments: list[float | None]) -> None:
    for name in ("good", "broken"):
        run = write_run(tmp_path / name, broken=name == "broken")
        (run / "recording.rrd").touch()
        command.view([run])
    found, estimate = read_run(run).failure, read_run(run).estimate
    assert found is not None
    assert estimate is not None
    assert moments == [None, pytest.approx(found.failure.stamp - estimate.stamps[0])]
    command.view([run], time=12.5)
    assert moments[-1] == 12.5


def test_a_time_that_cannot_be_shown_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--time is for the window"):
        command.view([tmp_path], time=1.0, serve=True)
    with pytest.raises(ValueError, match="expected seconds since the first scan"):
        command.view([tmp_path], time=-1.0)
