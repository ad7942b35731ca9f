# SPDX-License-Identifier: MIT
"""The recording of a run: every snapshot becomes entities of a Rerun file, which live viewers follow.

Poses, scan and plots are logged at most ten times a second; particles at every scan that the filter took in; maps,
paths and weights about once a second, after resampling, and at the end; the maps of four particles with every 15th
(`schedule`). What that costs is measured in docs/views.md. Stored poses are float32: the files of the run directory
are the source of truth.
"""

from __future__ import annotations

import errno
import os
import shutil
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from slam.step.step_report import StepReport
from testbed.views.live.viewers import LiveViewer, start_viewers
from testbed.views.rerun import drawing, entities, styles
from testbed.views.rerun.archetypes import grid_map, line, pose_transform, strips
from testbed.views.rerun.blueprints import blueprint
from testbed.views.rerun.columns import Columns
from testbed.views.rerun.scenery import Scenery
from testbed.views.schedule import Schedule
from testbed.views.view import Scene, Snapshot, ViewOptions

Z_TRUTH, Z_ODOMETRY, Z_FAN, Z_ESTIMATE, Z_TOP = 0.02, 0.03, 0.035, 0.04, 0.06
"""Heights at which things are drawn [m], so that they do not fight for the same pixels."""
MOST_POINTS = 360
"""Beams of a scan that are drawn."""
MOST_BRANCHES = 100
"""Particles whose recent path is drawn."""
FAN_LENGTH = 60
"""Updates of the recent paths."""
SEND_PERIOD = 0.5
"""Rows are sent this often [s of wall time], by the snapshot that comes next."""
FILE_PERIOD = 0.5
"""What was sent is written this often [s of wall time]: each time costs some 300 bytes per entity."""

SMALLEST_SPACE = 1 << 16
"""Bytes; with less than this left a disk counts as full."""


class RerunView:
    """Writes `recording.rrd` and keeps live viewers supplied. Use `open_view`."""

    def __init__(self, recording: Path, scene: Scene, options: ViewOptions) -> None:
        """Begin the file and start the viewers that the options ask for."""
        self._scene = scene
        self._schedule = Schedule()
        self._last: Snapshot | None = None
        self._start = 0.0
        self._scans = 0
        self._sent = time.monotonic()
        self._T_world_map = np.zeros(3)
        self._path_ends: dict[str, Pose] = {}
        self._states: dict[str, str] = {}
        run = str(uuid.uuid4())  # of its own: a viewer would merge runs of one id
        known = scene.true_map
        scenery = Scenery(
            particles=scene.particles,
            truth=known is not None,
            extent=None if known is None else drawing.extent_of(known, np.zeros(3)),
        )
        batches = rr.ChunkBatcherConfig.DEFAULT()
        batches.flush_tick = timedelta(seconds=FILE_PERIOD)
        self._rec = rr.RecordingStream(entities.APPLICATION, recording_id=run, batcher_config=batches)
        self._rec.set_log_time_enabled(False)
        self._recording = recording
        with self._file_errors():
            self._rec.set_sinks(rr.FileSink(recording), default_blueprint=blueprint(scenery))
        self._rec.send_recording_name(scene.title)
        self._columns = Columns(self._rec)
        styles.log_scene(self._rec, scene)
        self._viewers: list[LiveViewer] = start_viewers(recording, run, scenery, options)

    @property
    def address(self) -> str | None:
        """Address of the web page, where one is served."""
        return next((viewer.address for viewer in self._viewers if viewer.address), None)

    def show(self, snapshot: Snapshot) -> None:
        """Log one scan's news."""
        if self._last is None:
            self._align(snapshot)
        self._last = snapshot
        step = snapshot.step if snapshot.step is not None and snapshot.step.updated else None
        self._set_time(snapshot)
        self._log_events(snapshot)
        if self._schedule.frame_due(snapshot.stamp, step is not None):
            self._add_frame(snapshot)
        if step is not None:
            self._add_filter(step)
            self._add_particles(snapshot)
            self._extend_path(entities.ODOMETRY_PATH, snapshot.odometry, Z_ODOMETRY)
            self._extend_path(entities.TRUE_PATH, snapshot.truth, Z_TRUTH)
            if self._schedule.map_due(snapshot.stamp, step.resampled):
                self._log_map(snapshot)
        if time.monotonic() - self._sent > SEND_PERIOD:
            self._send()

    def finish(self, path: Pose, grid: OccupancyGrid) -> None:
        """Replace path (scans, 3), map and last pose by the result of a final pass."""
        last = self._last
        if last is None:
            return
        self._last = None  # its map is not the final one any more
        self._set_time(last)
        self._columns.add(entities.ESTIMATED_ROBOT, path[-1])
        self._rec.log(entities.MAP, grid_map(grid))
        self._rec.log(entities.PATH, line(path, Z_ESTIMATE))
        for entity in (entities.PARTICLES, entities.PARTICLE_PATHS, entities.COVARIANCE, entities.PROPOSAL):
            self._rec.log(entity, rr.Clear(recursive=True))
        self._rec.log(entities.EVENTS, rr.TextLog("final pass: path and map replaced", level="INFO"))
        self._fit_eye(grid)

    def close(self) -> None:
        """Log the last map, complete the file, and let the viewers have the rest."""
        if self._last is not None:
            self._set_time(self._last)
            self._add_frame(self._last)
            grid = self._log_map(self._last, last=True)
            if grid is not None:
                self._fit_eye(grid)
            self._last = None
        self._send()
        with self._file_errors():
            self._rec.flush()
        self._rec.disconnect()

    @contextmanager
    def _file_errors(self) -> Iterator[None]:
        """Raise what the recording's writer reports, such as a full disk, as an OSError that names the file."""
        try:
            yield
        except RuntimeError as error:
            full = shutil.disk_usage(self._recording.parent).free < SMALLEST_SPACE
            reason = os.strerror(errno.ENOSPC) if full else " ".join(f"{error}".split())
            raise OSError(errno.ENOSPC if full else errno.EIO, reason, str(self._recording)) from error

    def wait(self) -> None:
        """Serve the web page until Ctrl-C; returns at once where none is served."""
        for viewer in self._viewers:
            viewer.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _align(self, first: Snapshot) -> None:
        """Lay the frames of map and odometry on the world's, so that all three paths start at the same pose."""
        self._start = first.stamp
        if first.truth is not None:
            self._T_world_map = se2.compose(first.truth, se2.inverse(first.estimate))
        T_world_first = se2.compose(self._T_world_map, first.estimate)
        self._T_world_odom = se2.compose(T_world_first, se2.inverse(first.odometry))
        for entity, pose in (
            (entities.SLAM, self._T_world_map),
            (entities.COMPARE, self._T_world_map),
            (entities.ODOMETRY, self._T_world_odom),
        ):
            self._rec.log(entity, pose_transform(pose), static=True)

    def _set_time(self, snapshot: Snapshot) -> None:
        stamp = snapshot.stamp - self._start
        self._rec.set_time(entities.TIMELINE, duration=stamp)
        self._rec.set_time(entities.SCAN_TIMELINE, sequence=self._scans)
        self._columns.time = (stamp, self._scans)
        self._scans += 1

    def _send(self) -> None:
        self._sent = time.monotonic()
        self._columns.send()
        for viewer in self._viewers:
            viewer.check()

    def _add_frame(self, snapshot: Snapshot) -> None:
        """Poses, scan and errors."""
        add = self._columns.add
        add(entities.ESTIMATED_ROBOT, snapshot.estimate)
        if snapshot.scan is not None:
            add(entities.SCAN, drawing.lifted(drawing.scan_points(snapshot.scan, MOST_POINTS), Z_TOP))
        if snapshot.truth is None:
            return
        add(entities.TRUE_ROBOT, snapshot.truth)
        estimates = np.stack(
            [se2.compose(self._T_world_map, snapshot.estimate), se2.compose(self._T_world_odom, snapshot.odometry)]
        )
        miss = se2.between(snapshot.truth, estimates)
        add(entities.POSITION_ERROR, np.hypot(miss[:, 0], miss[:, 1]))
        add(entities.HEADING_ERROR, np.degrees(np.abs(miss[:, 2])))

    def _add_filter(self, step: StepReport) -> None:
        """What the filter says of itself."""
        add = self._columns.add
        add(entities.ESS_VALUE, np.array([step.ess]))
        if step.resampled:
            add(entities.ESS_RESAMPLED, np.array([step.ess]))
        add(entities.MATCHED, np.array([step.matched_share]))
        add(entities.STAGES, np.array([1e3 * step.seconds.get(stage, 0.0) for stage in ("match", "map", "resample")]))
        add(entities.COVARIANCE, *flat_ellipse(step.pose, step.covariance))
        if step.proposed is not None:
            mean, covariance = step.proposed.mean[step.best], step.proposed.covariance[step.best]
            add(entities.PROPOSAL_GAUSSIAN, *flat_ellipse(mean, covariance))

    def _add_particles(self, snapshot: Snapshot) -> None:
        if snapshot.poses is not None and snapshot.weights is not None:
            self._columns.add(
                entities.PARTICLES,
                drawing.lifted(snapshot.poses, Z_TOP),
                drawing.headings(snapshot.poses, self._scene.robot_radius),
                drawing.weight_colours(snapshot.weights),
            )
        samples = np.empty((0, 3)) if snapshot.proposal_samples is None else snapshot.proposal_samples
        self._columns.add(entities.PROPOSAL_SAMPLES, drawing.lifted(samples, Z_TOP))  # none: the last ones go away

    def _extend_path(self, entity: str, pose: Pose | None, z: float) -> None:
        """Log the last piece of a path that never changes afterwards; the view shows all pieces up to its time."""
        if pose is None:
            return
        end = self._path_ends.get(entity)
        self._path_ends[entity] = pose
        if end is not None:
            self._columns.add(entity, drawing.lifted(np.stack([end, pose]), z))

    def _log_events(self, snapshot: Snapshot) -> None:
        lines = [("WARN", note) for note in snapshot.notes]
        if snapshot.step is not None and snapshot.step.updated:
            state, news = filter_state(snapshot.step)
            self._enter(entities.FILTER_STATE, state)
            lines += news
        robot = styles.COLLIDED if snapshot.collided else styles.DRIVING
        if self._enter(entities.ROBOT_STATE, robot) and snapshot.collided:
            lines.append(("ERROR", "collision"))
        for level, text in lines:
            self._rec.log(entities.EVENTS, rr.TextLog(text, level=level))

    def _enter(self, lane: str, state: str) -> bool:
        """Note a change of state; whether there was one."""
        if self._states.get(lane) == state:
            return False
        self._states[lane] = state
        self._rec.log(lane, rr.StateChange(state=state))
        return True

    def _log_map(self, snapshot: Snapshot, last: bool = False) -> OccupancyGrid | None:
        """Log the best map, the particles' paths and the weights; the map, if there is one."""
        started = time.monotonic()
        if snapshot.path is not None:
            self._rec.log(entities.PATH, line(snapshot.path(None), Z_ESTIMATE))
            count = self._scene.particles if snapshot.weights is None else len(snapshot.weights)
            branches = [snapshot.path(i)[-FAN_LENGTH:] for i in range(min(count, MOST_BRANCHES))]
            limbs = [drawing.lifted(limb, Z_FAN) for limb in drawing.branches(branches)]
            self._rec.log(entities.PARTICLE_PATHS, rr.LineStrips3D.from_fields(strips=strips(limbs)))
        if snapshot.weights is not None:
            self._rec.log(entities.WEIGHTS, rr.BarChart(snapshot.weights))
        if snapshot.map is None:
            return None
        grid = snapshot.map(None)
        self._rec.log(entities.MAP, grid_map(grid))
        if last or self._schedule.comparison_due:
            self._log_comparison(snapshot)
        self._schedule.map_was_logged(snapshot.stamp, grid.probability.size, time.monotonic() - started)
        return grid

    def _log_comparison(self, snapshot: Snapshot) -> None:
        """Map, path and pose of four particles from the heaviest to the lightest."""
        if snapshot.weights is None or snapshot.poses is None or snapshot.map is None or snapshot.path is None:
            return
        chosen = drawing.spread_over_weights(snapshot.weights, len(entities.RANKS))
        for rank, particle in zip(entities.RANKS, chosen.tolist(), strict=True):
            base = f"{entities.COMPARE}/{rank}"
            self._rec.log(f"{base}/map", grid_map(snapshot.map(particle)))
            self._rec.log(f"{base}/path", line(snapshot.path(particle), Z_ESTIMATE))
            self._rec.log(f"{base}/robot", pose_transform(snapshot.poses[particle]))
            label = f"particle {particle}, weight {snapshot.weights[particle]:.3f}"
            mark = rr.Points3D([[0, 0, Z_TOP]], labels=label, colors=(255, 255, 255), radii=rr.Radius.ui_points(4.0))
            self._rec.log(f"{base}/robot/label", mark)

    def _fit_eye(self, grid: OccupancyGrid) -> None:
        """Once the place is known, let a viewer that opens the file see all of it."""
        if self._scene.true_map is None:
            scenery = Scenery(
                particles=self._scene.particles,
                truth=entities.TRUE_PATH in self._path_ends,
                extent=drawing.extent_of(grid, self._T_world_map),
            )
            self._rec.send_blueprint(blueprint(scenery), make_active=False, make_default=True)


def filter_state(step: StepReport) -> tuple[str, list[tuple[str, str]]]:
    """The filter's state after a scan that it took in, and (level, text) of what is worth a line in the event log."""
    state, news = styles.MAPPING, []
    if step.resampled:
        state = styles.RESAMPLED
        news.append(("INFO", f"resampled: effective sample size {step.ess:.1f} of {step.particles}"))
    if step.loop_closed:
        state = styles.LOOP_CLOSED
        news.append(("INFO", "loop closed: back at a place left long ago"))
    if step.match_failures:
        news.append(("WARN", f"match failed for {step.match_failures} of {step.particles} particles"))
    if 2 * step.match_failures > step.particles:
        state = styles.MATCH_FAILED
    return state, news


def flat_ellipse(
    pose: Pose, covariance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Centre (3,), half axes (3,) and quaternion (4,) of the ellipse about a pose that holds 95 % of the positions."""
    (long, short), angle = drawing.ellipse(covariance)
    return np.array([pose[0], pose[1], Z_TOP]), np.array([long, short, 1e-4]), np.array(drawing.quaternion(angle))
