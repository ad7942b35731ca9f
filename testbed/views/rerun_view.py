# SPDX-License-Identifier: MIT
"""The recording of a run: every snapshot becomes entities of a Rerun file, which live viewers follow.

What is logged when, so that ten minutes stay below 60 MB and a snapshot below 2 ms (measured: docs/views.md):
poses, scan and plots at most ten times a second; particles at every scan that the filter took in; maps, paths and
weights about once a second, after resampling, and at the end; the maps of four particles every ten seconds.
Stored poses are float32: the files of the run directory are the source of truth.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr

from slam import se2
from slam.gmapping import StepReport
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.views import drawing, entities
from testbed.views.blueprints import blueprint
from testbed.views.live import LiveViewer, start_viewers
from testbed.views.robot_model import log_robot
from testbed.views.scenery import Scenery
from testbed.views.schedule import Schedule
from testbed.views.view import Scene, Snapshot, ViewOptions

TRUTH, ODOMETRY, ESTIMATE = (60, 160, 80), (240, 150, 30), (40, 90, 210)
SCAN, COVARIANCE, PROPOSAL, FAN = (220, 40, 140), (120, 40, 200), (0, 150, 160), (110, 140, 190)
STATES = {
    "mapping": (90, 160, 90),
    "resampled": (230, 170, 40),
    "loop closed": (50, 100, 220),
    "match failed": (210, 50, 50),
}
ROBOT_STATES = {"driving": (150, 160, 170), "collided": (210, 50, 50)}
Z_TRUTH, Z_ODOMETRY, Z_FAN, Z_ESTIMATE, Z_TOP = 0.02, 0.03, 0.035, 0.04, 0.06
"""Heights at which things are drawn [m], so that they do not fight for the same pixels."""
MOST_POINTS = 360
"""Beams of a scan that are drawn."""
MOST_BRANCHES = 100
"""Particles whose recent path is drawn."""
FAN_LENGTH = 60
"""Updates of the recent paths."""


class RerunView:
    """Writes `recording.rrd` and keeps live viewers supplied. Use `open_view`."""

    def __init__(self, recording: Path, scene: Scene, options: ViewOptions) -> None:
        """Begin the file and start the viewers that the options ask for."""
        self._scene = scene
        self._schedule = Schedule()
        self._last: Snapshot | None = None
        self._start = 0.0
        self._scans = 0
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
        self._rec = rr.RecordingStream(entities.APPLICATION, recording_id=run)
        self._rec.set_sinks(rr.FileSink(recording), default_blueprint=blueprint(scenery))
        self._rec.send_recording_name(scene.title)
        self._log_scene()
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
        step = snapshot.step
        updated = step is not None and step.updated
        resampled = step is not None and step.resampled
        self._set_time(snapshot)
        self._log_events(snapshot)
        if self._schedule.frame_due(snapshot.stamp, updated):
            self._log_robots(snapshot)
            self._log_errors(snapshot)
        if step is not None and updated:
            self._log_filter(step)
            self._log_particles(snapshot)
            self._extend_path(entities.ODOMETRY_PATH, snapshot.odometry, Z_ODOMETRY)
            self._extend_path(entities.TRUE_PATH, snapshot.truth, Z_TRUTH)
        if updated and self._schedule.map_due(snapshot.stamp, resampled):
            self._log_map(snapshot)
        for viewer in self._viewers:
            viewer.check()

    def finish(self, path: Pose, grid: OccupancyGrid) -> None:
        """Replace path (scans, 3), map and last pose by the result of a final pass."""
        last = self._last
        if last is None:
            return
        self._last = None  # its map is not the final one any more
        self._set_time(last)
        self._rec.log(entities.MAP, grid_map(grid))
        self._rec.log(entities.PATH, strip(path, Z_ESTIMATE))
        self._rec.log(entities.ESTIMATED_ROBOT, pose_transform(path[-1]))
        for entity in (entities.PARTICLES, entities.PARTICLE_PATHS, entities.COVARIANCE, entities.PROPOSAL):
            self._rec.log(entity, rr.Clear(recursive=True))
        self._rec.log(entities.EVENTS, rr.TextLog("final pass: path and map replaced", level="INFO"))
        self._fit_eye(grid)

    def close(self) -> None:
        """Log the last map, complete the file, and let the viewers have the rest."""
        if self._last is not None:
            self._set_time(self._last)
            self._log_robots(self._last)
            grid = self._log_map(self._last, last=True)
            if grid is not None:
                self._fit_eye(grid)
            self._last = None
        self._rec.disconnect()
        for viewer in self._viewers:
            viewer.check()

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

    def _log_scene(self) -> None:
        """What never changes: axes, settings, true map, shapes of the robots, colours of lines and states."""
        rec, scene = self._rec, self._scene
        rec.log(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if scene.settings:
            document = rr.TextDocument(scene.settings, media_type=rr.MediaType.MARKDOWN)
            rec.log(entities.SETTINGS, document, static=True)
        if scene.true_map is not None:
            rec.log(entities.TRUE_MAP, grid_map(scene.true_map, z=0.01, opacity=0.4), static=True)
            log_robot(rec, scene, entities.TRUE_ROBOT, entities.TRUE_MODEL, TRUTH)
        log_robot(rec, scene, entities.ESTIMATED_ROBOT, entities.ESTIMATED_MODEL, ESTIMATE)
        for entity, colour, width in (
            (entities.TRUE_PATH, TRUTH, 2.5),
            (entities.ODOMETRY_PATH, ODOMETRY, 1.2),
            (entities.PATH, ESTIMATE, 1.2),
            (entities.PARTICLE_PATHS, FAN, 0.5),
        ):
            style = rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(width))
            rec.log(entity, style, static=True)
        rec.log(entities.SCAN, rr.Points3D.from_fields(colors=[SCAN], radii=rr.Radius.ui_points(1.5)), static=True)
        for entity, states in ((entities.FILTER_STATE, STATES), (entities.ROBOT_STATE, ROBOT_STATES)):
            rec.log(entity, rr.StateConfiguration(values=list(states), colors=list(states.values())), static=True)
        self._log_series()

    def _log_series(self) -> None:
        """Names and colours of the plotted series."""
        for entity, names, colours in (
            (entities.POSITION_ERROR, ["estimate", "odometry"], [ESTIMATE, ODOMETRY]),
            (entities.HEADING_ERROR, ["estimate", "odometry"], [ESTIMATE, ODOMETRY]),
            (f"{entities.ESS}/value", ["effective sample size"], [ESTIMATE]),
            (entities.MATCHED, ["matched share"], [ESTIMATE]),
            (entities.STAGES, ["match", "map", "resample"], [ESTIMATE, TRUTH, ODOMETRY]),
        ):
            self._rec.log(entity, rr.SeriesLines(names=names, colors=colours, widths=[1.5]), static=True)
        self._rec.log(
            f"{entities.ESS}/resampled",
            rr.SeriesPoints(names="resampled", colors=STATES["match failed"], markers="diamond", marker_sizes=4.0),
            static=True,
        )

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
        self._rec.set_time(entities.TIMELINE, duration=snapshot.stamp - self._start)
        self._rec.set_time(entities.SCAN_TIMELINE, sequence=self._scans)
        self._scans += 1

    def _log_robots(self, snapshot: Snapshot) -> None:
        rec = self._rec
        rec.log(entities.ESTIMATED_ROBOT, pose_transform(snapshot.estimate))
        if snapshot.truth is not None:
            rec.log(entities.TRUE_ROBOT, pose_transform(snapshot.truth))
        if snapshot.scan is not None:
            points = drawing.lifted(drawing.scan_points(snapshot.scan, MOST_POINTS), Z_TOP)
            rec.log(entities.SCAN, rr.Points3D.from_fields(positions=points))

    def _log_errors(self, snapshot: Snapshot) -> None:
        if snapshot.truth is None:
            return
        estimates = np.stack(
            [
                se2.compose(self._T_world_map, snapshot.estimate),
                se2.compose(self._T_world_odom, snapshot.odometry),
            ]
        )
        miss = se2.between(snapshot.truth, estimates)
        self._rec.log(entities.POSITION_ERROR, rr.Scalars(np.hypot(miss[:, 0], miss[:, 1])))
        self._rec.log(entities.HEADING_ERROR, rr.Scalars(np.degrees(np.abs(miss[:, 2]))))

    def _log_events(self, snapshot: Snapshot) -> None:
        step, rec = snapshot.step, self._rec
        lines = [("WARN", note) for note in snapshot.notes]
        if step is not None and step.updated:
            state = "mapping"
            if step.resampled:
                state = "resampled"
                rec.log(f"{entities.ESS}/resampled", rr.Scalars(step.ess))
                lines.append(("INFO", f"resampled: effective sample size {step.ess:.1f}"))
            if step.loop_closed:
                state = "loop closed"
                lines.append(("INFO", "loop closed: back at a place left long ago"))
            if step.match_failures:
                lines.append(("WARN", f"match failed for {step.match_failures} of {self._scene.particles} particles"))
            if 2 * step.match_failures > self._scene.particles:
                state = "match failed"
            self._enter(entities.FILTER_STATE, state)
        if self._enter(entities.ROBOT_STATE, "collided" if snapshot.collided else "driving") and snapshot.collided:
            lines.append(("ERROR", "collision"))
        for level, line in lines:
            rec.log(entities.EVENTS, rr.TextLog(line, level=level))

    def _enter(self, lane: str, state: str) -> bool:
        """Note a change of state; whether there was one."""
        if self._states.get(lane) == state:
            return False
        self._states[lane] = state
        self._rec.log(lane, rr.StateChange(state=state))
        return True

    def _log_filter(self, step: StepReport) -> None:
        rec = self._rec
        rec.log(f"{entities.ESS}/value", rr.Scalars(step.ess))
        rec.log(entities.MATCHED, rr.Scalars(step.matched_share))
        stages = [1e3 * step.seconds.get(stage, 0.0) for stage in ("match", "map", "resample")]
        rec.log(entities.STAGES, rr.Scalars(stages))
        rec.log(entities.COVARIANCE, ellipse(step.pose, step.covariance, COVARIANCE))
        if step.proposed is not None:
            mean, covariance = step.proposed.mean[step.best], step.proposed.covariance[step.best]
            rec.log(entities.PROPOSAL_GAUSSIAN, ellipse(mean, covariance, PROPOSAL))

    def _log_particles(self, snapshot: Snapshot) -> None:
        rec, length = self._rec, self._scene.robot_radius
        if snapshot.poses is not None and snapshot.weights is not None:
            arrows = rr.Arrows3D(
                origins=drawing.lifted(snapshot.poses, Z_TOP),
                vectors=drawing.headings(snapshot.poses, length),
                colors=drawing.weight_colours(snapshot.weights),
                radii=rr.Radius.ui_points(1.0),
            )
            rec.log(entities.PARTICLES, arrows)
        if snapshot.proposal_samples is not None:
            positions = drawing.lifted(snapshot.proposal_samples, Z_TOP)
            samples = rr.Points3D(positions, colors=PROPOSAL, radii=rr.Radius.ui_points(2.0))
            rec.log(entities.PROPOSAL_SAMPLES, samples)

    def _extend_path(self, entity: str, pose: Pose | None, z: float) -> None:
        """Log the last piece of a path that never changes afterwards; the view shows all pieces up to its time."""
        if pose is None:
            return
        end = self._path_ends.get(entity)
        self._path_ends[entity] = pose
        if end is not None:
            self._rec.log(entity, strip(np.stack([end, pose]), z))

    def _log_map(self, snapshot: Snapshot, last: bool = False) -> OccupancyGrid | None:
        """Log the best map, all paths and the weights; the map, if there is one."""
        if snapshot.path is not None:
            self._rec.log(entities.PATH, strip(snapshot.path(None), Z_ESTIMATE))
            self._log_fan([snapshot.path(i)[-FAN_LENGTH:] for i in range(min(self._scene.particles, MOST_BRANCHES))])
        if snapshot.weights is not None:
            self._rec.log(entities.WEIGHTS, rr.BarChart(snapshot.weights))
        if snapshot.map is None:
            return None
        grid = snapshot.map(None)
        self._schedule.map_was_logged(snapshot.stamp, grid.probability.size)
        self._rec.log(entities.MAP, grid_map(grid))
        if last or self._schedule.comparison_due(snapshot.stamp):
            self._log_comparison(snapshot)
        return grid

    def _log_fan(self, paths: Sequence[Pose]) -> None:
        strips = [drawing.lifted(limb, Z_FAN) for limb in drawing.branches(paths)]
        self._rec.log(entities.PARTICLE_PATHS, rr.LineStrips3D.from_fields(strips=strips))

    def _log_comparison(self, snapshot: Snapshot) -> None:
        """Map, path and pose of four particles from the heaviest to the lightest."""
        if snapshot.weights is None or snapshot.poses is None or snapshot.map is None or snapshot.path is None:
            return
        chosen = drawing.spread_over_weights(snapshot.weights, len(entities.RANKS))
        for rank, particle in zip(entities.RANKS, chosen.tolist(), strict=True):
            base = f"{entities.COMPARE}/{rank}"
            self._rec.log(f"{base}/map", grid_map(snapshot.map(particle)))
            self._rec.log(f"{base}/path", strip(snapshot.path(particle), Z_ESTIMATE, ESTIMATE))
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


def grid_map(grid: OccupancyGrid, z: float = 0.0, opacity: float = 1.0) -> rr.GridMap:
    """A map; its lower left corner lies at the grid's origin, raised by z [m]."""
    x, y, theta = grid.origin
    rows, cols = grid.probability.shape
    return rr.GridMap(
        data=drawing.cells_from_top(grid).tobytes(),
        format=rr.components.ImageFormat(width=cols, height=rows, color_model="L", channel_datatype="U8"),
        cell_size=grid.resolution,
        translation=(x, y, z),
        quaternion=rr.Quaternion(xyzw=drawing.quaternion(theta)),
        colormap=rr.components.Colormap.RvizMap,
        opacity=opacity,
    )


def pose_transform(pose: Pose) -> rr.Transform3D:
    """A pose (3,) of the plane."""
    return rr.Transform3D(
        translation=(pose[0], pose[1], 0.0), quaternion=rr.Quaternion(xyzw=drawing.quaternion(pose[2]))
    )


def strip(path: Pose, z: float, colour: tuple[int, int, int] | None = None) -> rr.LineStrips3D:
    """The line through the positions of a path (n, 3) at height z [m]; its colour, unless set once for all."""
    line = drawing.lifted(path, z)
    return rr.LineStrips3D([line], colors=colour, radii=None if colour is None else rr.Radius.ui_points(1.2))


def ellipse(pose: Pose, covariance: Pose, colour: tuple[int, int, int]) -> rr.Ellipsoids3D:
    """The ellipse about a pose (3,) that holds 95 % of the positions; covariance (3, 3)."""
    (long, short), angle = drawing.ellipse(covariance)
    return rr.Ellipsoids3D(
        centers=[[pose[0], pose[1], Z_TOP]],
        half_sizes=[[long, short, 1e-4]],
        quaternions=[rr.Quaternion(xyzw=drawing.quaternion(angle))],
        colors=colour,
        fill_mode="majorwireframe",
    )
