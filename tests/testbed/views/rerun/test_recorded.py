# SPDX-License-Identifier: MIT
"""What is read back from a recording is what was shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slam import se2
from testbed.views.rerun import entities
from testbed.views.rerun.recorded import GridImage, Recorded, ellipse, grid_image, joined, points, pose, strips
from tests.testbed.views.conftest import Recorded as Run


def test_at_each_time_the_newest_row_is_read(recorded: Run) -> None:
    read = Recorded(recorded.path)
    for snapshot in recorded.snapshots[::7]:
        row = read.latest(entities.ESTIMATED_ROBOT, snapshot.stamp - recorded.snapshots[0].stamp)
        assert row is not None
        assert pose(row) == pytest.approx(snapshot.estimate, abs=1e-5)
    assert read.latest(entities.ESTIMATED_ROBOT, -1.0) is None
    assert read.latest("/nothing", 1.0) is None


def test_particles_and_ellipse_are_those_of_the_last_update(recorded: Run) -> None:
    read, start = Recorded(recorded.path), recorded.snapshots[0].stamp
    updates = [snapshot for snapshot in recorded.snapshots if snapshot.step is not None and snapshot.step.updated]
    snapshot = updates[len(updates) // 2]
    particles = read.latest(entities.PARTICLES, snapshot.stamp - start)
    spread = read.latest(entities.COVARIANCE, snapshot.stamp - start)
    assert particles is not None
    assert spread is not None
    assert snapshot.poses is not None
    assert snapshot.step is not None
    assert points(particles["Arrows3D:origins"]) == pytest.approx(snapshot.poses[:, :2], abs=1e-5)
    shape, covariance = ellipse(spread), snapshot.step.covariance[:2, :2]
    axis = np.array([np.cos(shape.angle), np.sin(shape.angle)])
    assert shape.half[0] == pytest.approx(2.4477 * np.sqrt(axis @ covariance @ axis), rel=1e-3)


def test_the_drawn_path_reaches_the_robot_at_every_scan(recorded: Run) -> None:
    """The newest line begins where the last block ends, for estimate, truth and odometry."""
    read, start = Recorded(recorded.path), recorded.snapshots[0].stamp
    checked = 0
    for snapshot in recorded.snapshots[5:]:
        time = snapshot.stamp - start
        for path, end in ((entities.PATH, snapshot.estimate), (entities.ODOMETRY_PATH, snapshot.odometry)):
            blocks = [read.latest(name, time) for name in read.names(path) if "block" in name]
            ends = [strips(row["LineStrips3D:strips"])[-1][-1] for row in blocks if row is not None]
            newest = read.latest(f"{path}/newest", time)
            if not ends or newest is None:
                continue
            first, last = strips(newest["LineStrips3D:strips"])[0]
            assert first == pytest.approx(ends[-1], abs=1e-5)
            assert last == pytest.approx(end[:2], abs=1e-5)
            checked += 1
    assert checked > len(recorded.snapshots)


def test_the_pieces_of_the_map_are_put_together(recorded: Run) -> None:
    read = Recorded(recorded.path)
    pieces = [
        grid_image(read.fixed(name) | row)
        for name in read.names(entities.MAP)
        if (row := read.latest(name, np.inf)) is not None
    ]
    whole = joined(pieces)
    assert whole is not None
    assert len(pieces) > 1
    for piece in pieces:
        offset = np.rint(se2.between(whole.pose, piece.pose)[:2] / whole.cell).astype(int)
        top = whole.image.shape[0] - offset[1] - piece.image.shape[0]
        part = whole.image[top : top + piece.image.shape[0], offset[0] : offset[0] + piece.image.shape[1]]
        assert (part == piece.image).all()
    turned = GridImage(pieces[0].image, np.array([1.0, 2.0, 0.5]), 0.05)
    assert joined([turned]) is turned
    assert joined([]) is None


def test_what_is_no_recording_is_named(tmp_path: Path) -> None:
    (tmp_path / "recording.rrd").write_bytes(b"nothing of the kind")
    with pytest.raises(ValueError, match=r"recording\.rrd: expected a recording of Rerun"):
        Recorded(tmp_path / "recording.rrd")
