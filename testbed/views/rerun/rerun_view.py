# SPDX-License-Identifier: MIT
"""The recording of a run: every snapshot becomes entities of a Rerun file, which live viewers follow.

Poses, scan and plots are logged at most ten times a second; particles at every scan that the filter took in; map,
paths and the tree of histories before they become older than a second or half a metre, after each resampling, loop
closure and change of the best particle, and at the end; the comparison of particles every ten seconds (`schedule`). Map
and paths go in pieces of which only those that have changed are sent (`layers`). What that costs is measured in
docs/views.md. Stored poses are float32: the files of the run directory are the source of truth.
"""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr

from eval.wording import at_time, length
from slam import se2
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from slam.step.step_report import StepReport
from testbed.views.another_best import MIN_JUMP_M, errors_in_words, moved_by_another_best
from testbed.views.live.viewers import LiveViewer, start_viewers
from testbed.views.rerun import columns, drawing, entities
from testbed.views.rerun.archetypes import grid_map, lines, pose_transform, square_frame
from testbed.views.rerun.blueprints import blueprint
from testbed.views.rerun.columns import Columns, ErrorColumns, arrow_columns, line_columns, pair_columns
from testbed.views.rerun.layers import comparison
from testbed.views.rerun.layers.events import EventWatch, final_lines
from testbed.views.rerun.layers.loop_watch import LoopWatch
from testbed.views.rerun.layers.map_tiles import ImagePool, MapTiles
from testbed.views.rerun.layers.particle_tree import ParticleTree
from testbed.views.rerun.layers.path_blocks import GrowingPath, PathBlocks
from testbed.views.rerun.layers.prediction import Predictions
from testbed.views.rerun.now import NowColumns, within_ellipse
from testbed.views.rerun.recording_file import RecordingFile
from testbed.views.rerun.released_blueprint import released
from testbed.views.rerun.scene import styles
from testbed.views.rerun.scene.scenery import Scenery
from testbed.views.rerun.scene.styles import Z_ESTIMATE, Z_FAN
from testbed.views.schedule import Schedule
from testbed.views.view import FinalLoop, Scene, Snapshot, ViewOptions

MAX_POINTS = 240
"""Beams of a scan that are drawn."""
TREE_UPDATES = 20
"""The tree of histories is drawn again with the next map after this many updates."""
ARROW = 2.0
"""Length of a particle's arrow in radii of the robot."""
LIVE_PERIOD = 1.0
"""Rows are sent this often [s of wall time] while somebody watches, by the snapshot that comes next …"""
SEND_PERIOD = 20.0
"""… and this often into a file that nobody watches: calls cost more than rows …"""
MAX_WAITING = 2048
"""… or when so many squares of maps wait, of 16 kB each."""
MIN_WEIGHT_DIFFERENCE = 1e-9
"""Weights that differ by less are equal, as they are right after a resampling."""
FILE_PERIOD = 0.5
"""What was sent is written this often [s of wall time]: each time costs some 300 bytes per entity."""


class RerunView:
    """Writes `recording.rrd` and keeps live viewers supplied. Use `open_view`."""

    def __init__(self, recording: Path, scene: Scene, options: ViewOptions) -> None:
        """Begin the file and start the viewers that the options ask for."""
        self._scene = scene
        self._schedule = Schedule()
        self._last: Snapshot | None = None
        self._last_update: Snapshot | None = None
        self._start = 0.0
        self._scans = 0
        self._travelled = 0.0
        self._timed = False  # whether the recording stream has the time of the last snapshot
        self._pending = False  # whether the filter has changed since map and paths were logged
        self._drawn_best = -1  # the particle whose map was logged
        self._moved = (
            0.0  # by how much another particle, which became the best, moved the estimate at the last update [m]
        )
        self._jumped = False  # whether another particle became the best at the last update, and the estimate moved
        self._sent = time.monotonic()
        self._T_world_map = np.zeros(3)
        self._errors: list[ErrorColumns] = []  # of the position, of the heading
        self._events, self._loops = EventWatch(), LoopWatch()
        self._images = ImagePool(MAX_WAITING)
        self._tiles, self._tree = MapTiles(self._images), ParticleTree()
        self._path = PathBlocks()
        self._since: list[Pose] | None = (
            None  # poses of the best particle since its path was sent; None: its past changed
        )
        self._predictions = None if scene.motion is None else Predictions(scene.motion)
        self._visited = {entities.TRUE_PATH: GrowingPath(), entities.ODOMETRY_PATH: GrowingPath()}
        self._updates_in_tree = 0  # since the tree was drawn
        self._slots = comparison.slots(self._images)
        self._ends: dict[str, Pose] = {}  # last pose of each path that was sent
        self._styled: set[str] = set()
        self._hits: columns.Values | None = None  # of the last scan that was added
        self._within: bool | None = None  # whether the ellipse of the last update held the truth
        self._within_at = 0.0  # its stamp [s]
        self._whole_map: OccupancyGrid | None = None
        self._refined = False
        run = str(uuid.uuid4())  # of its own: a viewer would merge runs of one id
        batches = rr.ChunkBatcherConfig.DEFAULT()
        batches.flush_tick = timedelta(seconds=FILE_PERIOD)
        self._rec = rr.RecordingStream(entities.APPLICATION, recording_id=run, batcher_config=batches)
        self._rec.set_log_time_enabled(False)
        self._file = RecordingFile(recording, self._rec, blueprint(self._scenery(None)))
        self._rec.send_recording_name(scene.title)
        self._columns = Columns(self._rec)
        self._arrows = arrow_columns(ARROW * scene.robot_radius)
        self._newest = {entity: (f"{entity}/newest", pair_columns(z)) for entity, (_, _, z) in styles.PATHS.items()}
        styles.log_scene(self._rec, scene)
        self._viewers: list[LiveViewer] = start_viewers(recording, run, self._scenery(None), options)

    @property
    def address(self) -> str | None:
        """Address of the web page, where one is served."""
        return next((viewer.address for viewer in self._viewers if viewer.address), None)

    def show(self, snapshot: Snapshot) -> None:
        """Log what one scan has changed."""
        if self._last is None:
            self._align(snapshot)
        step = snapshot.step if snapshot.step is not None and snapshot.step.updated else None
        next_step = self._advance(snapshot)
        self._set_time(snapshot)
        frame_due = self._schedule.frame_due(snapshot.stamp, step is not None)
        if frame_due:
            self._add_frame(snapshot)
        died = 0 if step is None else self._add_update(snapshot, step)
        self._log_events(snapshot, died)
        at_once = step is not None and (step.resampled or step.loop_closed)
        another = snapshot.cells is not None and snapshot.best != self._drawn_best  # no map but that of the pose
        if self._pending and (at_once or another or self._schedule.map_due(snapshot.stamp, self._travelled, next_step)):
            self._add_map_and_paths(snapshot)
        if frame_due:
            self._add_newest(snapshot)
        if step is not None and self._schedule.comparison_due(snapshot.stamp, at_once, self._jumped):
            self._add_comparison(snapshot)
        period = LIVE_PERIOD if self._viewers else SEND_PERIOD
        if time.monotonic() - self._sent > period or self._images.full:
            self._send()

    def _advance(self, snapshot: Snapshot) -> tuple[float, float]:
        """Count the way since the last snapshot; returns its time [s] and length [m]."""
        last, self._last = self._last, snapshot
        if last is None:
            return 0.0, 0.0
        (x, y, _), (x_before, y_before, _) = snapshot.odometry.tolist(), last.odometry.tolist()
        distance = math.hypot(x - x_before, y - y_before)
        self._travelled += distance
        return abs(snapshot.stamp - last.stamp), distance

    def finish(self, path: Pose, grid: OccupancyGrid, loops: Sequence[FinalLoop] = ()) -> None:
        """Show map and path before and after a final pass, and the loops that it found; path (scans, 3)."""
        last = self._last
        if last is None:
            return
        self._close_run(last)
        self._refined = True
        before = None if last.path is None or last.map is None else (last.path(None), last.map(None))
        for number, (step, shown) in enumerate(zip(entities.FINAL_STEPS, (before, (path, grid)), strict=True)):
            if shown is not None:
                self._log_final("path", number, lines([shown[0]], Z_ESTIMATE), styles.line_style(styles.ESTIMATE, 1.2))
                self._log_final("map", number, grid_map(shown[1]))
            for kind, colour in styles.FINAL_LOOPS.items():
                links = [loop.before if step == "before" else loop.after for loop in loops if loop.kind == kind]
                if links:
                    row = lines(links, styles.Z_TOP)
                    self._log_final(f"loops/{kind}", number, row, styles.line_style(colour, 1.8))
        truth = self._visited[entities.TRUE_PATH].poses
        if len(truth):
            self._rec.log(entities.FINAL_TRUTH, styles.line_style(styles.TRUTH, 2.5), static=True)
            self._rec.log(entities.FINAL_TRUTH, lines([truth], styles.Z_TRUTH), static=True)
        self._rec.reset_time()
        self._set_time(last)
        for line in final_lines(loops):
            self._columns.add_event(line.text, line.level)
        self._fit_view(grid)

    def _log_final(
        self, name: str, number: int, content: rr.AsComponents, style: rr.AsComponents | None = None
    ) -> None:
        """Log what belongs to a step of the final pass: for the view of the step, and for the timeline of the steps."""
        for base, static in (
            (f"{entities.FINAL}/{entities.FINAL_STEPS[number]}", True),
            (f"{entities.FINAL}/step", False),
        ):
            self._rec.reset_time()
            if style is not None:
                self._rec.log(f"{base}/{name}", style, static=True)
            self._rec.set_time(entities.FINAL_PASS_TIMELINE, sequence=number)
            self._rec.log(f"{base}/{name}", content, static=static)

    def close(self) -> None:
        """Log the last map, complete the file, and let the viewers have the rest."""
        last, self._last = self._last, None
        try:
            if last is not None:
                self._close_run(last)
                if last.map is not None and not self._refined:
                    self._fit_view(last.map(None))
            self._send()
        finally:
            self._file.close()

    def _close_run(self, last: Snapshot) -> None:
        """Log the state after the last snapshot, in full."""
        if self._refined:
            return
        self._set_time(last)
        self._add_frame(last)
        self._add_map_and_paths(last, everything=True)
        self._add_newest(last)
        self._add_comparison(last, everything=True)
        for level, text, at in self._loops.end(self._events.lost):
            self._columns.add_event(text, level, at=at)

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
        """Align the frames of map and odometry to the world's, so that all three paths start at the same pose."""
        self._start = first.stamp
        if self._scene.T_world_map is not None:
            self._T_world_map = self._scene.T_world_map
        elif first.truth is not None:
            self._T_world_map = se2.compose(first.truth, se2.inverse(first.estimate))
        T_world_first = se2.compose(self._T_world_map, first.estimate)
        if first.truth is not None:
            T_world_first = first.truth
        self._T_world_odom = se2.compose(T_world_first, se2.inverse(first.odometry))
        self._around = columns.world_places(self._T_world_map)
        self._now = NowColumns(self._T_world_map)
        self._errors = [ErrorColumns(self._T_world_map, self._T_world_odom, heading) for heading in (False, True)]
        for entity in (entities.SLAM, entities.COMPARE, entities.PROPOSAL, entities.FINAL):
            self._rec.log(entity, pose_transform(self._T_world_map), static=True)
        self._rec.log(entities.ODOMETRY, pose_transform(self._T_world_odom), static=True)

    def _set_time(self, snapshot: Snapshot) -> None:
        """Let what is added or logged from now on belong to a snapshot."""
        self._columns.time = (snapshot.stamp - self._start, self._scans)
        self._timed = False
        self._scans += 1

    def _log(self, entity: str, *what: rr.AsComponents) -> None:
        """Log something at the time of the snapshot."""
        if not self._timed:
            stamp, scan = self._columns.time
            self._rec.set_time(entities.TIMELINE, duration=stamp)
            self._rec.set_time(entities.SCAN_TIMELINE, sequence=scan)
            self._timed = True
        self._rec.log(entity, *what)

    def _send(self) -> None:
        self._sent = time.monotonic()
        for at, pose, covariance, disagreement in self._predictions.take() if self._predictions is not None else ():
            self._columns.add(entities.PROPOSAL_PRIOR, pose, covariance, at=at)
            if disagreement is not None:
                self._columns.add_event(disagreement, "WARN", at=at)
        self._columns.send()
        self._images.clear()
        self._file.check()
        for viewer in self._viewers:
            viewer.check()

    # --- each scan

    def _add_frame(self, snapshot: Snapshot) -> None:
        """Add poses, scan and errors."""
        add = self._columns.add
        add(entities.ESTIMATED_ROBOT, snapshot.estimate)
        if snapshot.truth is not None and snapshot.step is not None and snapshot.step.updated:
            step, T_map_world = snapshot.step, se2.inverse(self._T_world_map)
            self._within = within_ellipse(se2.compose(T_map_world, snapshot.truth), step.pose, step.covariance)
            self._within_at = snapshot.stamp
        age = abs(snapshot.stamp - self._within_at)
        add(entities.NOW, snapshot.estimate, snapshot.truth, self._within, age, build=self._now)
        self._hits = None if snapshot.scan is None else drawing.thinned_hits(snapshot.scan, MAX_POINTS)
        if self._hits is not None:
            add(entities.SCAN, *self._hits)
        if snapshot.truth is None:
            return
        add(entities.TRUE_ROBOT, snapshot.truth)
        for entity, build in zip((entities.POSITION_ERROR, entities.HEADING_ERROR), self._errors, strict=True):
            add(entity, snapshot.truth, snapshot.estimate, snapshot.odometry, build=build)

    def _add_newest(self, snapshot: Snapshot) -> None:
        """Add the lines from the ends of the paths, as far as they were sent, to the poses."""
        poses = {entities.PATH: snapshot.estimate, entities.ODOMETRY_PATH: snapshot.odometry}
        if snapshot.truth is not None:
            poses[entities.TRUE_PATH] = snapshot.truth
        for entity, pose in poses.items():
            if entity in self._ends:
                name, build = self._newest[entity]
                self._columns.add(name, self._ends[entity], pose, build=build)

    def _log_events(self, snapshot: Snapshot, died: int) -> None:
        step, loops = snapshot.step, []
        if step is not None and step.updated:
            spread = _spread_of(snapshot) if step.loop_closed or self._loops.closing else None
            loops = self._loops.update(self._columns.time, step, died, self._moved, spread, self._events.lost)
        lines, states = self._events.update(snapshot, self._columns.time, died, loops)
        for lane, state, at in states:
            self._columns.add(lane, state, at=at)
        for level, text, at in lines:
            self._columns.add_event(text, level, at=at)

    # --- each update of the filter

    def _add_update(self, snapshot: Snapshot, step: StepReport) -> int:
        """Add what the filter did; returns how many particles died."""
        self._pending, self._jumped, self._moved = True, False, 0.0
        self._add_filter(step)
        self._add_particles(snapshot)
        for entity, pose in ((entities.TRUE_PATH, snapshot.truth), (entities.ODOMETRY_PATH, snapshot.odometry)):
            if pose is not None:
                self._visited[entity].append(pose)
        before, self._last_update = self._last_update, snapshot
        if before is not None and self._predictions is not None and snapshot.localization is None:
            self._predictions.add(self._columns.time, before, snapshot)
        same = before is not None and before.best == step.best and not step.resampled and snapshot.localization is None
        if self._since is not None and same:
            self._since.append(step.pose)
        else:
            self._since = None
        if before is not None:
            self._mark_another_best(before, snapshot, step)
        self._add_proposal(snapshot)
        return self._add_to_tree(snapshot, step)

    def _mark_another_best(self, before: Snapshot, snapshot: Snapshot, step: StepReport) -> None:
        """Mark the error where the estimate moves because another particle became the best."""
        if snapshot.localization is not None:  # whose numbers of particles do not go on from update to update
            return
        moved = moved_by_another_best(before.best, step)
        if not moved > MIN_JUMP_M:
            return
        self._jumped, self._moved = True, moved
        words = f"{entities.ANOTHER_BEST_EVENT}: the reported pose moved by {length(moved)}"
        if snapshot.truth is not None and before.truth is not None:
            rows = [(shown.truth, shown.estimate, shown.odometry) for shown in (before, snapshot)]
            errors = self._errors[0].of(rows)[:, 0].tolist()
            words += f", {errors_in_words(*errors)}"
            self._columns.add(entities.ANOTHER_BEST, *rows[1], build=self._errors[0].estimates)
        self._columns.add_event(words, "INFO")

    def _add_filter(self, step: StepReport) -> None:
        """Add what the filter says of itself."""
        add, seconds = self._columns.add, step.seconds
        add(entities.ESS_VALUE, step.ess)
        if step.resampled:
            add(entities.ESS_RESAMPLED, step.ess)
        add(entities.PROPOSAL_EYE, step.pose)
        add(entities.AROUND, step.pose, build=self._around)
        add(entities.MATCHED, step.matched_share)
        add(entities.STAGES, *(1e3 * seconds.get(stage, 0.0) for stage in ("match", "map", "resample")))
        add(entities.COVARIANCE, step.pose, step.covariance)

    def _add_particles(self, snapshot: Snapshot) -> None:
        if snapshot.poses is None or snapshot.weights is None:
            return
        self._columns.add(entities.PARTICLES, snapshot.poses, snapshot.weights, build=self._arrows)
        if self._scene.particles > 1:
            self._columns.add(entities.SPREAD, snapshot.poses, snapshot.weights)
        self._columns.add(entities.PARTICLE_DOTS, snapshot.poses, snapshot.weights)

    def _add_proposal(self, snapshot: Snapshot) -> None:
        """Add samples, fitted Gaussian, and the scan from its mean; without a proposal the samples go away."""
        add, proposal = self._columns.add, snapshot.proposal
        if proposal is None:
            add(entities.PROPOSAL_SAMPLES, np.empty((0, 3)), np.empty(0))
            return
        weights = np.ones(len(proposal.samples)) if proposal.weights is None else proposal.weights
        add(entities.PROPOSAL_SAMPLES, proposal.samples, weights)
        add(entities.PROPOSAL_GAUSSIAN, proposal.mean, proposal.covariance)
        add(entities.PROPOSAL_OPTIMUM, proposal.mean)
        if self._hits is not None:
            ranges, angles, mount = self._hits
            add(entities.PROPOSAL_SCAN, ranges[::2], angles[::2], mount)  # drawn close up

    def _add_to_tree(self, snapshot: Snapshot, step: StepReport) -> int:
        """Add the update to the tree of histories; returns how many particles died."""
        if snapshot.poses is None:
            return 0
        self._updates_in_tree += 1
        proposed = snapshot.poses if step.proposed is None else step.proposed.pose
        branches = self._tree.add(
            proposed, snapshot.poses, resampled=step.resampled or snapshot.localization is not None
        )
        if branches is None:
            return 0
        if branches.shape[1] > 1:
            thin = branches[:, :: max(1, branches.shape[1] // 50)]
            self._columns.add(entities.DEAD_BRANCHES, *thin, build=line_columns(Z_FAN))
        return len(branches)

    # --- map and paths

    def _add_map_and_paths(self, snapshot: Snapshot, everything: bool = False) -> None:
        """Add what has changed of the best map and of all paths, and the tree of the particles' histories."""
        self._schedule.map_was_logged(snapshot.stamp, self._travelled)
        self._pending, self._drawn_best = False, snapshot.best
        if snapshot.path is not None:
            if everything or self._since is None:
                self._add_path(entities.PATH, self._path.changes(snapshot.path(None)))
            else:
                self._add_path(entities.PATH, self._path.extended(np.array(self._since)))
            self._since = []
            if self._path.end is not None:  # the last update: the pose of this scan may be later
                self._ends[entities.PATH] = self._path.end
        for entity, visited in self._visited.items():
            self._add_path(entity, visited.changes())
            if len(visited.poses):
                self._ends[entity] = visited.poses[-1].copy()
        resampled = snapshot.step is not None and snapshot.step.resampled
        if everything or resampled or self._updates_in_tree >= TREE_UPDATES:
            self._updates_in_tree = 0
            self._columns.add(entities.PARTICLE_PATHS, *self._tree.strips(), build=line_columns(Z_FAN))
        if snapshot.cells is not None:
            exact = everything or self._jumped  # no wall of another particle may stay
            self._add_squares(entities.MAP, self._tiles, snapshot, snapshot.best, exact)
        elif snapshot.map is not None:
            self._log_whole_map(snapshot.map(None))

    def _add_squares(self, entity: str, tiles: MapTiles, snapshot: Snapshot, particle: int, everything: bool) -> None:
        """Add the squares of a particle's map that have changed."""
        assert snapshot.cells is not None
        cells = snapshot.cells(particle)
        for square in tiles.changes(cells, everything):
            name = entities.square(entity, square.grid_index)
            if name not in self._styled:
                self._styled.add(name)
                frame = square_frame(square.grid_index, cells.cell * tiles.coarse)
                self._rec.log(name, frame, static=True)
            self._columns.add(name, square.image, build=columns.images)

    def _add_path(self, entity: str, blocks: list[tuple[int, Pose]]) -> None:
        """Add the blocks of a path that have changed."""
        colour, width, z = styles.PATHS[entity]
        for number, part in blocks:
            name = entities.block(entity, number)
            if name not in self._styled:
                self._styled.add(name)
                self._rec.log(name, styles.line_style(colour, width), static=True)
            self._columns.add(name, part, build=line_columns(z))

    def _log_whole_map(self, grid: OccupancyGrid) -> None:
        """Log a map that comes as a whole, unless it is the one that is there."""
        if grid is not self._whole_map:
            self._whole_map = grid
            self._log(entities.MAP, grid_map(grid))

    # --- comparison of particles

    def _add_comparison(self, snapshot: Snapshot, everything: bool = False) -> None:
        """Add weights, and map, path and pose of four particles."""
        if snapshot.weights is None or snapshot.poses is None or snapshot.path is None:
            return
        self._log(entities.WEIGHTS, rr.BarChart(snapshot.weights))
        if snapshot.cells is None:
            return
        equal = entities.EQUAL_WEIGHT if np.ptp(snapshot.weights) < MIN_WEIGHT_DIFFERENCE else ""
        for slot, particle in zip(self._slots, comparison.chosen(snapshot), strict=True):
            if slot is not self._slots[0]:  # the best particle's map and path are there
                self._add_squares(f"{slot.entity}/map", slot.tiles, snapshot, particle, everything)
                self._add_path(f"{slot.entity}/path", slot.path.changes(snapshot.path(particle)))
            self._columns.add(f"{slot.entity}/robot", snapshot.poses[particle], build=columns.poses)
            label = f"particle {particle}, weight {snapshot.weights[particle]:.3f}{equal}"
            if slot is not self._slots[0]:  # the map of the best particle is renewed at each second
                label += f"{entities.AS_OF}{at_time(self._columns.time[0])}"
            self._columns.add(f"{slot.entity}/robot/label", label, build=columns.labels)

    # --- layout

    def _scenery(self, extent: drawing.Extent | None) -> Scenery:
        """What the layout depends on, as far as it is known."""
        known = self._scene.true_map
        metres, degrees = [errors.maxima for errors in self._errors] or [(0.0, 0.0)] * 2
        return Scenery(
            particles=self._scene.particles,
            truth=known is not None or len(self._visited[entities.TRUE_PATH].poses) > 0,
            extent=extent if known is None else drawing.extent_of(known, np.zeros(3)),
            max_error_m=metres[0] if any(metres) else None,
            max_error_deg=degrees[0] if any(metres) else None,
            max_odometry_error_m=max(metres) if any(metres) else None,
            final_pass=self._refined,
        )

    def _fit_view(self, grid: OccupancyGrid) -> None:
        """Once all is known, let a viewer that opens the file see all of it, on axes that fit."""
        self._send()
        scenery = self._scenery(drawing.extent_of(grid, self._T_world_map))
        with released(blueprint(scenery)) as sent:
            self._rec.send_blueprint(sent, make_active=False, make_default=True)


def _spread_of(snapshot: Snapshot) -> float | None:
    """Standard deviation of the position over the particles [m]; None with a single one, or where they are unknown."""
    if snapshot.poses is None or snapshot.weights is None or len(snapshot.poses) == 1:
        return None
    return float(drawing.spreads([(snapshot.poses, snapshot.weights)])[0])
