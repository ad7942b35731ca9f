# SPDX-License-Identifier: MIT
"""Several recordings in one: each run below a root of its own, on one time that counts from its first scan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from testbed.views import open_view, record_frames, record_side_by_side
from testbed.views.rerun import entities
from testbed.views.rerun.blueprints import HALF_VIEW, HEIGHT_PER_METRE
from testbed.views.rerun.drawing import extent_of
from testbed.views.rerun.side_by_side import MAX_RUNS
from tests.testbed.views.conftest import Recorded
from tests.testbed.views.rerun.test_frames_recording import frames
from tests.testbed.views.shown_map import ShownMap, rows, views
from tests.testbed.views.synthetic import scene, snapshots
from tests.viewer import viewer_or_skip


@pytest.fixture(scope="module")
def later(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a run whose clock is far ahead."""
    path = tmp_path_factory.mktemp("later") / "recording.rrd"
    with open_view(path, scene()) as view:
        for snapshot in snapshots(5.0, particles=3, seed=1):
            view.show(replace(snapshot, stamp=snapshot.stamp + 1e6))
    return path


@pytest.fixture(scope="module")
def both(recorded: Recorded, later: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("both") / "side_by_side.rrd"
    record_side_by_side(path, [("one", recorded.path), ("other", later)])
    return path


def test_each_run_is_below_its_root_and_begins_at_zero(recorded: Recorded, later: Path, both: Path) -> None:
    for number, path in enumerate((recorded.path, later), start=1):
        for entity, column in (
            (entities.ESTIMATED_ROBOT, "Transform3D:translation"),
            (entities.POSITION_ERROR, "Scalars:scalars"),
            (entities.block(entities.PATH, 0), "LineStrips3D:strips"),
        ):
            own = rows(path, entity, column)
            assert rows(both, f"/run_{number}{entity}", column) == own
            assert own[0][0] == 0.0
    grid = recorded.snapshots[-1].map
    assert grid is not None
    one = ShownMap(both, f"/run_1{entities.MAP}").at(20.0, grid(None))
    np.testing.assert_array_equal(one, ShownMap(recorded.path).at(20.0, grid(None)))


def test_the_curves_are_named_after_the_runs(both: Path) -> None:
    for number, title in enumerate(("one", "other"), start=1):
        ((_, names),) = rows(both, f"/run_{number}{entities.POSITION_ERROR}", "SeriesLines:names", static=True)
        assert names == [f"{number}: {title}", f"{number}: odometry"]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a drive without an estimate, over its true map."""
    path = tmp_path_factory.mktemp("drive") / "drive.rrd"
    record_frames(path, frames(), scene())
    return path


def test_the_view_of_a_drive_is_fitted_to_its_map(drive: Path, tmp_path: Path) -> None:
    path, true_map = tmp_path / "two.rrd", scene().true_map
    assert true_map is not None
    record_side_by_side(path, [("one", drive), ("other", drive)])
    extent = extent_of(true_map, np.zeros(3))
    side = max((extent.x_max - extent.x_min) / HALF_VIEW, extent.y_max - extent.y_min)
    targets, eyes, followed = (
        views(path, f"EyeControls3D:{name}") for name in ("look_target", "position", "tracking_entity")
    )
    for name in ("1: one", "2: other"):
        assert targets[name][:2] == pytest.approx(extent.centre, abs=1e-3)
        assert eyes[name][2] == pytest.approx(HEIGHT_PER_METRE * side, rel=1e-4)
        assert followed[name] is None


def test_a_drive_of_unknown_size_is_followed_by_its_odometry(tmp_path: Path) -> None:
    log, both = tmp_path / "log.rrd", tmp_path / "two.rrd"
    record_frames(log, [replace(frame, truth=None) for frame in frames()], replace(scene(), true_map=None))
    record_side_by_side(both, [("one", log), ("other", log)])
    followed = views(both, "EyeControls3D:tracking_entity")
    assert followed["1: one"] == f"/run_1{entities.ODOMETRY_ROBOT}"
    assert followed["2: other"] == f"/run_2{entities.ODOMETRY_ROBOT}"


def test_the_legends_are_those_of_what_is_shown(drive: Path, recorded: Recorded, tmp_path: Path) -> None:
    """One where it is the same for all; drives and runs have two."""
    same, mixed = tmp_path / "same.rrd", tmp_path / "mixed.rrd"
    record_side_by_side(same, [("one", drive), ("other", drive)])
    record_side_by_side(mixed, [("drive", drive), ("run", recorded.path), ("again", drive)])
    for path, legends in (
        (same, {"Legend": (1, drive)}),
        (mixed, {"Legend of 1, 3": (1, drive), "Legend of 2": (2, recorded.path)}),
    ):
        origins = views(path, "ViewBlueprint:space_origin")
        entity = f"{entities.LEGEND}/map"
        assert {name for name in origins if name.startswith("Legend")} == set(legends)
        for name, (number, own) in legends.items():
            assert origins[name] == f"/run_{number}{entity}"
            blob = "EncodedImage:blob"
            assert rows(path, origins[name], blob, static=True) == rows(own, entity, blob, static=True)


def test_too_many_runs_and_files_that_hold_none_are_refused(recorded: Recorded, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"{MAX_RUNS + 1} runs, expected at most {MAX_RUNS}"):
        record_side_by_side(tmp_path / "many.rrd", [("run", recorded.path)] * (MAX_RUNS + 1))
    other = tmp_path / "other.rrd"
    with rr.RecordingStream("other") as stream:
        stream.save(other)
        stream.log("/text", rr.TextLog("no run"))
    with pytest.raises(ValueError, match=r"other\.rrd: no recording of a run"):
        record_side_by_side(tmp_path / "both.rrd", [("run", recorded.path), ("other", other)])
    assert not (tmp_path / "both.rrd").exists()


def test_the_viewer_draws_both_maps_without_complaint(both: Path) -> None:
    with viewer_or_skip() as viewer:
        viewer.open(both)
        for name in ("1: one", "2: other"):
            assert len(viewer.picture(4.0, name)) > 0
        assert viewer.complaints() == []
