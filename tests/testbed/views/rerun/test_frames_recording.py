# SPDX-License-Identifier: MIT
"""A drive without an estimate can be watched: scans by the truth, scans by the odometry, no text of URDFs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from testbed.frame import Frame
from testbed.views import record_frames, recording_of
from testbed.views.rerun import entities
from testbed.views.rerun.frames_recording import ODOMETRY_SCAN, TRUE_SCAN
from tests.testbed.views.shown_map import rows
from tests.testbed.views.synthetic import scan_at, scene, truth_at


def frames() -> list[Frame]:
    """Two seconds in the room; the odometry has a frame of its own and drifts."""
    made = []
    for k in range(21):
        truth = truth_at(0.1 * k)
        odometry = np.add(se2.compose([1.0, -2.0, 0.5], se2.between(truth_at(0.0), truth)), [0.002 * k, 0.0, 0.0])
        made.append(Frame(stamp=100.0 + 0.1 * k, odometry=odometry, truth=truth, scan=scan_at(truth, 0.1 * k)))
    return made


def test_robot_and_scans_are_where_truth_and_odometry_put_them(tmp_path: Path) -> None:
    path, shown = tmp_path / "drive.rrd", frames()
    record_frames(path, shown, scene())
    assert recording_of(path) == path
    for entity, poses in (
        (entities.TRUE_ROBOT, [f.truth for f in shown]),
        (entities.ODOMETRY_ROBOT, [f.odometry for f in shown]),
    ):
        found = rows(path, entity, "Transform3D:translation")
        assert [time for time, _ in found] == pytest.approx(0.1 * np.arange(21))
        np.testing.assert_allclose([value[0][:2] for _, value in found], np.array(poses)[:, :2], atol=1e-5)
    for entity in (TRUE_SCAN, ODOMETRY_SCAN):
        assert all(len(points) == 180 for _, points in rows(path, entity, "Points3D:positions"))


def test_without_truth_only_the_odometry_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "log.rrd"
    record_frames(path, [replace(f, truth=None) for f in frames()], replace(scene(), true_map=None))
    assert rows(path, TRUE_SCAN, "Points3D:positions") == []
    assert len(rows(path, ODOMETRY_SCAN, "Points3D:positions")) == 21


def test_a_drive_without_scans_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no scan in it"):
        record_frames(tmp_path / "none.rrd", [replace(f, scan=None) for f in frames()], scene())


def test_recordings_leave_no_threads_behind(tmp_path: Path) -> None:
    """Rerun keeps the stream of a blueprint, with two threads, unless it is disconnected."""
    tasks = Path("/proc/self/task")
    if not tasks.exists():
        pytest.skip("threads are counted in /proc")
    counts = []
    for k in range(8):
        record_frames(tmp_path / f"{k}.rrd", frames()[:3], scene())
        counts.append(len(list(tasks.iterdir())))
    assert counts[-1] <= counts[1] + 2
