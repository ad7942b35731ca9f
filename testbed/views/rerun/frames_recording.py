# SPDX-License-Identifier: MIT
"""A drive without an estimate as a recording: the robot, and its scans laid out by the truth and by the odometry."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from slam import se2
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.views.rerun import drawing, entities
from testbed.views.rerun.archetypes import grid_map, pose_transform
from testbed.views.rerun.blueprints import legend_view, map_view
from testbed.views.rerun.columns import Columns, line_columns, poses, scans
from testbed.views.rerun.layers.path_blocks import GrowingPath
from testbed.views.rerun.recording_file import RecordingFile
from testbed.views.rerun.scene import styles
from testbed.views.rerun.scene.legend import Entry, legend_image
from testbed.views.rerun.scene.robot_model import log_robot
from testbed.views.view import Scene

ODOMETRY_SCAN = f"{entities.ODOMETRY_ROBOT}/scan"
TRUE_SCAN = f"{entities.TRUE_ROBOT}/scan"
MAX_POINTS = 240
"""Beams of a scan that are drawn."""
LEGEND_OF_TRUTH: tuple[Entry, ...] = (
    ("line", (styles.TRUTH,), "truth: path, robot, walls"),
    ("dot", (styles.SCAN,) * 3, "scan, from the true pose"),
)
LEGEND_OF_ODOMETRY: tuple[Entry, ...] = (
    ("line", (styles.ODOMETRY,), "odometry: path, robot"),
    ("dot", (styles.ODOMETRY,) * 3, "scan, from the odometry"),
)


def write_frames(recording: Path, frames: Iterable[Frame], scene: Scene) -> None:
    """Write a drive as a recording. Without truth everything is in the odometry's frame.

    Raises ValueError where no frame has a scan.
    """
    rec = rr.RecordingStream(entities.APPLICATION)
    rec.set_log_time_enabled(False)
    with closing(RecordingFile(recording, rec, _blueprint(scene))) as file:
        rec.send_recording_name(scene.title)
        count = _add_frames(rec, frames, scene, file)
    if count == 0:
        raise ValueError(f"{scene.title}: no scan in it, expected frames with scans")


def _add_frames(rec: rr.RecordingStream, frames: Iterable[Frame], scene: Scene, file: RecordingFile) -> int:
    """Add all frames that have a scan; returns their number."""
    columns, first, number = Columns(rec), None, 0
    paths: dict[str, GrowingPath] = {}
    for number, frame in enumerate(f for f in frames if f.scan is not None):
        if first is None:
            first = frame
            _log_static(rec, scene, truth=frame.truth is not None)
            T_world_odom = np.zeros(3) if frame.truth is None else se2.compose(frame.truth, se2.inverse(frame.odometry))
            rec.log(entities.ODOMETRY, pose_transform(T_world_odom), static=True)
        columns.time = (frame.stamp - first.stamp, number)
        assert frame.scan is not None
        seen = drawing.thinned_hits(frame.scan, MAX_POINTS)
        drawn: list[tuple[str, str, str, Pose | None]] = [
            (entities.TRUE_ROBOT, TRUE_SCAN, entities.TRUE_PATH, frame.truth),
            (entities.ODOMETRY_ROBOT, ODOMETRY_SCAN, entities.ODOMETRY_PATH, frame.odometry),
        ]
        for robot, scan, path, pose in drawn:
            if pose is not None:
                columns.add(robot, pose, build=poses)
                columns.add(scan, *seen, build=scans)
                paths.setdefault(path, GrowingPath()).append(pose)
        if number % 10 == 0:
            for path, grown in paths.items():
                _add_blocks(rec, columns, path, grown)
        if number % 500 == 499:
            columns.send()
            file.check()
    for path, grown in paths.items():
        _add_blocks(rec, columns, path, grown)
    columns.send()
    return 0 if first is None else number + 1


def _log_static(rec: rr.RecordingStream, scene: Scene, truth: bool) -> None:
    """Log what never changes; `truth`: whether true poses are known."""
    rec.log(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if scene.true_map is not None:
        styles.log_true_walls(rec, scene)
        rec.log(entities.TRUE_MAP, grid_map(scene.true_map), static=True)  # floor is white, what is solid grey
    log_robot(rec, entities.ODOMETRY_ROBOT, scene.robot_radius, styles.ODOMETRY)
    if truth:
        log_robot(rec, entities.TRUE_ROBOT, scene.robot_radius, styles.TRUTH)
    for scan, colour in ((TRUE_SCAN, styles.SCAN), (ODOMETRY_SCAN, styles.ODOMETRY)):
        rec.log(scan, rr.Points3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(1.5)), static=True)
    legend = (*(LEGEND_OF_TRUTH if truth else ()), *LEGEND_OF_ODOMETRY)
    image = rr.EncodedImage(contents=legend_image([legend]), media_type="image/png")
    rec.log(f"{entities.LEGEND}/map", image, static=True)


def _add_blocks(rec: rr.RecordingStream, columns: Columns, path: str, grown: GrowingPath) -> None:
    """Add what a path has grown by."""
    colour, width, z = styles.PATHS[path]
    for number, part in grown.changes():
        name = entities.block(path, number)
        if name not in columns.build:
            rec.log(name, styles.line_style(colour, width), static=True)
        columns.add(name, part, build=line_columns(z))


def _blueprint(scene: Scene) -> rrb.Blueprint:
    extent = None if scene.true_map is None else drawing.extent_of(scene.true_map, np.zeros(3))
    return rrb.Blueprint(
        rrb.Vertical(
            map_view(scene.title, extent, follow=entities.ODOMETRY_ROBOT), legend_view("map"), row_shares=[14, 1]
        ),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
