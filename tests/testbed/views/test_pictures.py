# SPDX-License-Identifier: MIT
"""What the native viewer draws, on pixels: the right things, the right way round, where they belong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from scipy.ndimage import binary_dilation

from slam import se2
from testbed.views import ViewOptions, open_view
from testbed.views.rerun import drawing, entities, rerun_view
from testbed.views.rerun.drawing import HEAVY, LIGHT
from testbed.views.rerun.scene.styles import ESTIMATE, ODOMETRY, SCAN, TRUTH
from tests.testbed.views.conftest import SECONDS, Recorded
from tests.testbed.views.synthetic import BOX, scene, snapshots
from tests.viewer import near, pixels, viewer_or_skip
from tools.headless_viewer import HeadlessViewer

WALL, FREE, UNKNOWN = (0, 0, 0), (255, 255, 255), (205, 205, 205)
"""Colours of a map; what was not seen has the colour of the background."""


@pytest.fixture(scope="module")
def viewer() -> Iterator[HeadlessViewer]:
    with viewer_or_skip() as opened:
        yield opened


@pytest.fixture
def sent_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A view sends twice a second, when a snapshot comes: a test that stops in between must not wait for the rest."""
    for period in ("SEND_PERIOD", "LIVE_PERIOD"):
        monkeypatch.setattr(rerun_view, period, 0.0)


@dataclass(frozen=True)
class Plan:
    """A picture of the map with the way from the world to its pixels."""

    picture: np.ndarray
    extent: drawing.Extent

    def __post_init__(self) -> None:
        rows, cols = np.nonzero(~near(self.picture, UNKNOWN, 6))
        # the map is the largest thing: its edges are the extent's
        object.__setattr__(self, "_box", (cols.min(), cols.max() + 1, rows.min(), rows.max() + 1))

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(row, col) of points (n, 2) of the world."""
        left, right, top, bottom = self._box  # type: ignore[attr-defined]
        e = self.extent
        col = left + (points[:, 0] - e.x_min) / (e.x_max - e.x_min) * (right - left)
        row = bottom - (points[:, 1] - e.y_min) / (e.y_max - e.y_min) * (bottom - top)
        return np.column_stack([row, col]).astype(int)

    def share_near(self, colour: tuple[int, int, int], points: np.ndarray, reach: int, tolerance: int = 40) -> float:
        """Share of the points with a pixel of the colour within `reach` pixels."""
        found = binary_dilation(near(self.picture, colour, tolerance), iterations=reach)
        row, col = self.pixels(points).T
        return float(found[row, col].mean())


@pytest.fixture(scope="module")
def plan(viewer: HeadlessViewer, recorded: Recorded) -> Plan:
    viewer.open(recorded.path)
    picture = pixels(viewer.picture(SECONDS, "Map"))
    assert viewer.complaints() == []
    first, last = recorded.snapshots[0], recorded.snapshots[-1]
    assert last.map is not None
    T_world_map = se2.compose(first.truth, se2.inverse(first.estimate))
    grid = last.map(None)
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * grid.probability.shape[::-1] * grid.resolution
    drawn = se2.transform_points(se2.compose(T_world_map, grid.origin), corners)
    (x_min, y_min), (x_max, y_max) = drawn.min(axis=0), drawn.max(axis=0)
    return Plan(picture, drawing.Extent(x_min, y_min, x_max, y_max))


def test_the_map_is_in_the_picture_and_not_mirrored(plan: Plan) -> None:
    left, low, right, high = BOX
    inside = np.array([[(left + right) / 2, (low + high) / 2], [left + 0.4, low + 0.4]])
    assert plan.share_near(UNKNOWN, inside, reach=1) == 1.0
    mirrored = np.array([[8.0 - left - 0.5, low + 0.5], [left + 0.5, 6.0 - low - 0.5], [8.0 - left - 0.5, 1.0]])
    assert plan.share_near(FREE, mirrored, reach=1, tolerance=12) == 1.0
    box_front = np.column_stack([np.full(20, left), np.linspace(low + 0.2, high - 0.2, 20)])
    room_side = np.column_stack([np.zeros(40), np.linspace(0.5, 5.5, 40)])
    for wall in (box_front, room_side):
        assert plan.share_near(WALL, wall, reach=4, tolerance=60) > 0.9


def test_paths_of_truth_estimate_and_odometry_are_where_they_went(plan: Plan, recorded: Recorded) -> None:
    first, shown = recorded.snapshots[0], recorded.snapshots[:-15]  # the lines end up to a second ago
    truth = np.array([s.truth for s in shown])
    T_world_map = se2.compose(first.truth, se2.inverse(first.estimate))
    T_world_odom = se2.compose(first.truth, se2.inverse(first.odometry))
    estimate = se2.compose(T_world_map, np.array([s.estimate for s in shown]))
    odometry = se2.compose(T_world_odom, np.array([s.odometry for s in shown]))
    for colour, path in ((ESTIMATE, estimate), (ODOMETRY, odometry), (TRUTH, truth)):
        assert plan.share_near(colour, path[:, :2], reach=4, tolerance=50) > 0.5  # a good estimate hides the truth
    assert plan.share_near(ODOMETRY, np.array([[1.0, 5.0], [7.0, 1.0]]), reach=4) == 0.0


def test_scan_and_particles_are_where_the_robot_is(plan: Plan, recorded: Recorded) -> None:
    last = recorded.snapshots[-1]
    assert last.scan is not None
    T_world_map = se2.compose(recorded.snapshots[0].truth, se2.inverse(recorded.snapshots[0].estimate))
    T_world_robot = se2.compose(T_world_map, last.estimate)
    ends = se2.transform_points(T_world_robot, drawing.scan_points(last.scan, 360))
    assert plan.share_near(SCAN, ends, reach=3, tolerance=70) > 0.8
    row, col = plan.pixels(T_world_robot[None, :2])[0]
    around = plan.picture[row - 25 : row + 25, col - 25 : col + 25].astype(int)
    between = np.add(LIGHT, HEAVY) / 2.0
    reddish = (around[..., 0] - around[..., 1] > 50) & (np.abs(around - between).max(axis=-1) < 130)
    assert reddish.sum() > 20


def test_the_robot_always_stands_on_mapped_floor(plan: Plan, tmp_path: Path) -> None:
    path, shown = tmp_path / "recording.rrd", list(snapshots(14.0, reach=2.8))  # it sees little of the room at a time
    with open_view(path, scene()) as view:
        for snapshot in shown:
            view.show(snapshot)
    T_world_map = se2.compose(shown[0].truth, se2.inverse(shown[0].estimate))
    with viewer_or_skip() as opened:
        opened.open(path)
        for k in (80, 120):
            picture = pixels(opened.picture(shown[k].stamp, "Map"))
            row, col = plan.pixels(se2.compose(T_world_map, shown[k].estimate)[None, :2])[0]
            around = picture[row - 40 : row + 40, col - 40 : col + 40]
            # particles and paths hide much of it; of a map that is seconds old nothing is left here
            assert near(around, FREE, 30).mean() > 0.08, f"at {shown[k].stamp} s"


@pytest.mark.usefixtures("sent_at_once")
def test_a_viewer_that_is_connected_shows_the_run_while_it_goes_on(viewer: HeadlessViewer, tmp_path: Path) -> None:
    with open_view(tmp_path / "recording.rrd", scene(), ViewOptions(connect=viewer.url)) as view:
        for snapshot in snapshots(5.0):
            view.show(snapshot)
        viewer.await_recording(until=5.0)  # before the recording is complete
        picture = pixels(viewer.picture(5.0, "Map"))
    assert near(picture, WALL, 60).sum() > 500
    assert near(picture, ESTIMATE, 50).sum() > 50
    assert viewer.complaints() == []


@pytest.mark.slow  # a viewer of its own; that one which is lost is told of, is among the fast tests of the relay
@pytest.mark.usefixtures("sent_at_once")
def test_a_viewer_that_is_closed_leaves_the_recording_going_on(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with viewer_or_skip() as opened:
        view = open_view(path, scene(), ViewOptions(connect=opened.url))
        shown = iter(snapshots(10.0))
        for _ in range(20):
            view.show(next(shown))
        opened.await_recording(until=1.0)
    for snapshot in shown:
        view.show(snapshot)
    view.close()
    ends = [t for c in rr.chunk.RrdReader(path).stream().filter(content=entities.ESTIMATED_ROBOT, is_static=False)
            for t in c.to_record_batch().column(entities.TIMELINE).to_pylist()]  # fmt: skip
    assert max(ends).total_seconds() == 10.0
