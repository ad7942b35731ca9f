# SPDX-License-Identifier: MIT
"""The map that is shown is the filter's best map of that time, however fast the run is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam.config import FilterConfig
from slam.gmapping import GMapping
from testbed.formats import open_log
from testbed.run.snapshot import take_snapshot
from testbed.views import Snapshot, open_view
from testbed.views.rerun import entities, rerun_view
from tests.testbed.views.shown_map import UNSEEN, ShownMap, kinds
from tests.testbed.views.synthetic import scene, snapshots

INTEL = Path(__file__).parents[4] / "shared/datasets/intel/intel-910.clf.gz"


def fast() -> Iterator[Snapshot]:
    """A simulated run, as fast as the filter can."""
    return snapshots(30.0)


def sparse() -> Iterator[Snapshot]:
    """A robot whose lidar takes one scan in two seconds."""
    return snapshots(120.0, particles=5, period=2.0)


def log() -> Iterator[Snapshot]:
    """The beginning of a recorded log with a scan every three seconds."""
    if not INTEL.is_file():
        pytest.skip("the Intel log is not there")
    mapper = GMapping(FilterConfig(particles=8))
    for k, frame in enumerate(open_log(INTEL).frames):
        if k == 120:
            return
        assert frame.scan is not None
        yield take_snapshot(frame, mapper.process(frame.odometry, frame.scan), mapper)


@pytest.mark.parametrize("run", [fast, sparse, log])
def test_the_map_that_is_shown_is_the_filters(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, stamps, grids = tmp_path / "recording.rrd", [], []
    now = 0.0
    monkeypatch.setattr(rerun_view.time, "monotonic", lambda: now)  # the wall clock plays no part in what is shown
    with open_view(path, replace(scene(), true_map=None)) as view:
        for snapshot in run():
            view.show(snapshot)
            stamps.append(snapshot.stamp)
            assert snapshot.map is not None
            grids.append(snapshot.map(None))
    shown, start = ShownMap(path), stamps[0]
    for at in np.random.default_rng(0).uniform(stamps[0], stamps[-1], 10):
        k = int(np.searchsorted(stamps, at, side="right")) - 1
        held, seen = kinds(grids[k]), shown.at(at - start, grids[k])
        known = held != UNSEEN
        assert np.mean(seen[known] == held[known]) >= 0.98, f"at {at - start:.1f} s"
    final = kinds(grids[-1])
    np.testing.assert_array_equal(shown.at(stamps[-1] - start, grids[-1]), final)


def test_the_map_is_new_after_each_resampling_and_loop_closure(tmp_path: Path) -> None:
    path, events = tmp_path / "recording.rrd", []
    with open_view(path, scene()) as view:
        for snapshot in snapshots(20.0):
            view.show(snapshot)
            if snapshot.step is not None and (snapshot.step.resampled or snapshot.step.loop_closed):
                assert snapshot.map is not None
                events.append((snapshot.stamp, snapshot.map(None)))
    assert len(events) > 3
    shown = ShownMap(path)
    for stamp, grid in events:
        held, seen = kinds(grid), shown.at(stamp, grid)
        assert np.mean(seen[held != UNSEEN] == held[held != UNSEEN]) >= 0.99


def test_compared_particles_have_their_own_maps(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with open_view(path, scene()) as view:
        for snapshot in snapshots(12.0):
            view.show(snapshot)
    assert snapshot.map is not None
    assert snapshot.weights is not None
    for rank, particle in (("best", snapshot.best), ("lightest", np.argmin(snapshot.weights))):
        grid = snapshot.map(int(particle))
        seen = ShownMap(path, f"{entities.COMPARE}/{rank}/map").at(snapshot.stamp, grid)
        held = kinds(grid)
        assert np.mean(seen[held != UNSEEN] == held[held != UNSEEN]) >= 0.99
