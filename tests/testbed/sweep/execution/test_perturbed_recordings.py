# SPDX-License-Identifier: MIT
"""The setting `perturb` changes the recording of a cell, for all systems alike, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from testbed.formats.write import write_log
from testbed.stress.table import perturb
from testbed.sweep.errors import SweepError
from testbed.sweep.execution.recordings import forget_recordings, recording_of
from testbed.sweep.spec.cell import Cell, recording_key
from testbed.sweep.spec.settings import checked
from tests.testbed.recordings import two_lidar_drive


def cell(source: dict, seed: int = 1, **settings) -> Cell:
    return Cell(place="p", source=source, line="l", settings=settings, particles=1, seed=seed, inputs={}, code="none")


OFFICE = {"world": "office"}
SHORT = {"duration": 6.0, "route": "random"}


def scans(one: Cell) -> list[bool]:
    return [frame.scan is not None for frame in recording_of(one).source.frames]


@pytest.mark.parametrize("source", [OFFICE, "log"])
def test_the_recording_of_a_cell_is_perturbed_by_its_seed(source, tmp_path: Path) -> None:
    if source == "log":
        write_log(tmp_path / "log", two_lidar_drive(), "parquet")
        source, settings = {"log": str(tmp_path / "log")}, {}
    else:
        settings = SHORT
    forget_recordings()
    plain, one, other = (
        cell(source, **settings),
        cell(source, **settings, perturb="drop-scans=0.5"),
        cell(source, seed=2, **settings, perturb="drop-scans=0.5"),
    )
    before = recording_of(plain).source.frames
    expected = perturb(before, {"drop-scans": 0.5}, one.seeds.perturbation)
    assert scans(one) == [frame.scan is not None for frame in expected]
    assert scans(one) != scans(other)
    assert scans(plain) == [frame.scan is not None for frame in before]
    np.testing.assert_array_equal([f.truth for f in recording_of(one).source.frames], [f.truth for f in before])


def test_systems_share_a_recording_and_perturbations_do_not() -> None:
    of = {system: cell(OFFICE, **SHORT, system=system, perturb="askew=3") for system in ("odometry", "gmapping")}
    assert recording_key(of["odometry"]) == recording_key(of["gmapping"])
    assert recording_key(of["odometry"]) != recording_key(cell(OFFICE, **SHORT, system="odometry", perturb="askew=4"))
    log = {"log": "robot.log"}
    assert recording_key(cell(log, seed=1)) == recording_key(cell(log, seed=2))
    assert recording_key(cell(log, seed=1, perturb="askew=3")) != recording_key(cell(log, seed=2, perturb="askew=3"))


def test_wrong_perturbations_are_refused_as_settings() -> None:
    assert checked("perturb", "askew=3+beams=20", recorded=True) == "askew=3+beams=20"
    with pytest.raises(SweepError, match="perturb = 'ask=3': ask: no such perturbation"):
        checked("perturb", "ask=3", recorded=False)
