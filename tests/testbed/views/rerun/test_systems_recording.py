# SPDX-License-Identifier: MIT
"""What several systems made of one drive: a layer for each, at the poses, with the map and the errors given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam.occupancy import OccupancyGrid
from testbed.views import SystemLayer, record_systems, recording_of
from testbed.views.rerun import drawing, entities
from tests.testbed.views.rerun.test_frames_recording import frames
from tests.testbed.views.shown_map import rows
from tests.testbed.views.synthetic import scene
from tests.viewer import near, pixels, viewer_or_skip

RED, BLUE = (201, 42, 42), (24, 100, 171)


def layers() -> list[SystemLayer]:
    """One system that is right at all scans and has a map, and one that is 0.3 m off from the sixth scan on."""
    truth = np.array([frame.truth for frame in frames()])
    cells = np.full((40, 60), 0.1, np.float32)
    grid = OccupancyGrid(probability=cells, resolution=0.05, origin=(-1.0, -2.0, 0.5))
    errors = np.zeros(21)
    errors[3] = np.nan
    late = np.arange(5, 21)
    cloud = {row: (np.array([[row, 0.0, 0.0], [row, 1.0, 0.0]]), np.array([0.25, 0.75])) for row in (0, 7)}
    return [
        SystemLayer(name="right", colour=BLUE, rows=np.arange(21), poses=truth, errors=errors, grid=grid),
        SystemLayer(
            name="off", colour=RED, rows=late, poses=truth[late] + [0.3, 0, 0], errors=np.full(16, 0.3), particles=cloud
        ),
    ]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("systems") / "recording.rrd"
    record_systems(path, frames(), layers(), scene())
    return path


def test_each_layer_has_its_poses_scans_and_errors(recording: Path) -> None:
    assert recording_of(recording.parent) == recording
    for layer in layers():
        root, error = f"{entities.SYSTEMS}/{layer.name}", f"{entities.POSITION_ERROR}/{layer.name}"
        robots = rows(recording, f"{root}/robot", "Transform3D:translation")
        assert [time for time, _ in robots] == pytest.approx(0.1 * layer.rows)
        np.testing.assert_allclose([value[0][:2] for _, value in robots], layer.poses[:, :2], atol=1e-5)
        assert len(rows(recording, f"{root}/robot/scan", "Points3D:positions")) == len(layer.rows)
        strip = rows(recording, f"{root}/path/block_0", "LineStrips3D:strips")[-1][1][0]
        np.testing.assert_allclose(np.array(strip)[:, :2], layer.poses[:, :2], atol=1e-5)
        known = np.isfinite(layer.errors)
        shown = rows(recording, error, "Scalars:scalars")
        np.testing.assert_allclose([value[0] for _, value in shown], layer.errors[known])
        assert [time for time, _ in shown] == pytest.approx(0.1 * layer.rows[known])
        ((_, names),) = rows(recording, error, "SeriesLines:names", static=True)
        assert names == [layer.name]


def test_particles_are_drawn_at_their_scans_the_heaviest_in_red(recording: Path) -> None:
    """Also where the system reports no pose, as before its first one."""
    root = f"{entities.SYSTEMS}/off"
    shown = rows(recording, f"{root}/particles", "Points3D:positions")
    assert [time for time, _ in shown] == pytest.approx([0.0, 0.7])
    np.testing.assert_allclose(np.array(shown[1][1])[:, :2], [[7.0, 0.0], [7.0, 1.0]])
    colours = rows(recording, f"{root}/particles", "Points3D:colors")[0][1]
    assert colours[1] >> 24 == drawing.HEAVY[0]
    assert colours[0] != colours[1]
    assert rows(recording, f"{entities.SYSTEMS}/right/particles", "Points3D:positions") == []


def test_a_map_lies_at_its_origin_and_where_there_is_none_nothing_is_shown(recording: Path) -> None:
    ((_, place),) = rows(recording, f"{entities.SYSTEMS}/right/map", "GridMap:translation", static=True)
    assert place[0][:2] == pytest.approx([-1.0, -2.0])
    assert rows(recording, f"{entities.SYSTEMS}/off/map", "GridMap:translation", static=True) == []


def test_without_truth_there_are_neither_errors_nor_a_true_path(tmp_path: Path) -> None:
    path = tmp_path / "log.rrd"
    shown = [replace(layer, errors=None) for layer in layers()]
    record_systems(path, [replace(f, truth=None) for f in frames()], shown, replace(scene(), true_map=None))
    assert rows(path, f"{entities.POSITION_ERROR}/off", "Scalars:scalars") == []
    assert rows(path, entities.TRUE_ROBOT, "Transform3D:translation") == []
    assert len(rows(path, f"{entities.SYSTEMS}/off/robot", "Transform3D:translation")) == 16


def test_nothing_to_show_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no system has a path"):
        record_systems(tmp_path / "none.rrd", frames(), [], scene())
    assert not (tmp_path / "none.rrd").exists()


def test_the_viewer_draws_the_systems_side_by_side_without_complaint(recording: Path) -> None:
    with viewer_or_skip() as viewer:
        viewer.open(recording)
        for layer, other in zip(layers(), reversed(layers()), strict=True):
            picture = pixels(viewer.picture(2.0, layer.name))
            assert near(picture, layer.colour).sum() > 50
            assert near(picture, other.colour).sum() == 0
        assert viewer.complaints() == []
