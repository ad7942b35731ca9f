# SPDX-License-Identifier: MIT
"""What a run shows to the view beside it."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest

from slam.config import FilterConfig, ProposalConfig
from testbed.cli.shared.console import progress_line
from testbed.estimation.estimation import Estimation
from testbed.frame import Frame
from testbed.run.execute import execute_job
from testbed.run.job import Job, RecordedFrames
from testbed.run.run_directory import RunDirectory
from testbed.systems.filter_system import FilterSystem
from testbed.views import NullView, Snapshot
from tests.testbed.views.synthetic import snapshots


class Watching(NullView):
    """Keeps what it is shown."""

    def __init__(self) -> None:
        self.shown: list[Snapshot] = []

    def show(self, snapshot: Snapshot) -> None:
        self.shown.append(snapshot)


class Collision(RecordedFrames):
    """Frames of a robot that touches something from a number of shown scans on."""

    def __init__(self, frames: list[Frame], view: Watching, first: int | None) -> None:
        super().__init__(frames)
        self._view, self._first = view, first

    @property
    def collided(self) -> bool:
        return self._first is not None and len(self._view.shown) >= self._first


def watched(path: Path, config: FilterConfig, seconds: float, collided_from: int | None = None) -> list[Snapshot]:
    """What a run of the synthetic room shows; the robot touches something from a number of scans on."""
    frames = [Frame(stamp=s.stamp, odometry=s.odometry, scan=s.scan, truth=s.truth) for s in snapshots(seconds)]
    view = Watching()
    job = Job(
        source=Collision(frames, view, collided_from),
        document={},
        seed=0,
        system=FilterSystem(config, refine=False, threads=None),
    )
    with progress_line() as watcher:
        execute_job(job, RunDirectory.create(path / "run"), watcher, view)
    assert [s.stamp for s in view.shown] == [frame.stamp for frame in frames]
    return view.shown


def test_collisions_are_shown_from_their_scan_on(tmp_path: Path) -> None:
    shown = watched(tmp_path, FilterConfig(particles=2), seconds=1.0, collided_from=4)
    assert [s.collided for s in shown] == [k >= 4 for k in range(len(shown))]


def test_samples_of_the_best_particle_are_shown_at_updates(tmp_path: Path) -> None:
    shown = watched(tmp_path, FilterConfig(particles=5), seconds=3.0)
    proposed = [s.step is not None and s.step.proposed is not None for s in shown]
    assert 3 < sum(proposed) < len(shown)
    for snapshot, updated in zip(shown, proposed, strict=True):
        assert (snapshot.proposal is not None) == updated
        if updated:
            assert snapshot.step is not None
            assert snapshot.step.proposed is not None
            expected = snapshot.step.proposed.samples[snapshot.step.best]
            assert snapshot.proposal is not None
            np.testing.assert_array_equal(snapshot.proposal.samples, expected)


def test_the_motion_model_as_proposal_shows_no_samples(tmp_path: Path) -> None:
    config = FilterConfig(particles=5, proposal=ProposalConfig(kind="motion"))
    shown = watched(tmp_path, config, seconds=1.0)
    assert any(s.step is not None and s.step.proposed is not None for s in shown)
    assert all(s.proposal is None for s in shown)


def test_an_error_after_the_mapping_keeps_what_was_estimated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OverflowError("cannot convert float infinity to integer")

    monkeypatch.setattr(Estimation, "refined", fail)
    frames = [Frame(stamp=s.stamp, odometry=s.odometry, scan=s.scan, truth=s.truth) for s in snapshots(1.0)]
    system = FilterSystem(FilterConfig(particles=2), refine=True, threads=None)
    job = Job(source=RecordedFrames(frames), document={}, seed=0, system=system)
    with progress_line() as watcher, pytest.raises(OverflowError):
        execute_job(job, RunDirectory.create(tmp_path / "run"), watcher)
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (metrics["outcome"], metrics["reason"]) == ("failed", "cannot convert float infinity to integer")
    for name in ("estimate.tum", "odometry.tum", "map.pgm", "steps.parquet"):
        assert (tmp_path / "run" / name).is_file(), name


class Interrupting:
    """A watcher that sends Ctrl-C so many times when the final pass first says how far it has come."""

    def __init__(self, times: int) -> None:
        self._times = times

    def stage(self, text: str) -> None:
        pass

    def step(self, stamp: float, share: float | None, error: float | None) -> None:
        pass

    def share(self, done: float) -> None:
        times, self._times = self._times, 0
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("times", [1, 2])
def test_an_interrupted_final_pass_keeps_its_rounds_or_the_path_of_the_filter(tmp_path: Path, times: int) -> None:
    """The first Ctrl-C ends it after the round that it is in, the second at once."""
    frames = [Frame(stamp=s.stamp, odometry=s.odometry, scan=s.scan, truth=s.truth) for s in snapshots(1.0)]
    config = FilterConfig(particles=2)
    job = Job(
        source=RecordedFrames(frames), document={}, seed=0, system=FilterSystem(config, refine=True, threads=None)
    )
    metrics = execute_job(job, RunDirectory.create(tmp_path / "run"), Interrupting(times))
    assert metrics["outcome"] == "interrupted"
    assert metrics["refined"] == (times == 1)
    noted = [note for note in metrics["notes"] if "after 1 of 6 rounds" in note]
    assert len(noted) == (times == 1)
    assert (tmp_path / "run" / "estimate.tum").is_file()
