# SPDX-License-Identifier: MIT
"""Estimation over a whole recording: the filter processes all frames, odometry fills the gaps in the path."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.config import FilterConfig
from slam.gmapping import GMapping
from slam.localization import Localization
from slam.motion.continuous_odometry import join_odometry
from slam.motion.interpolation import between_updates
from slam.refinement import Refined, refine
from slam.refinement.progress import Watch, unwatched
from slam.scan import Scan
from slam.se2 import Pose
from slam.step.step_report import StepReport
from testbed.estimation.known_map import KnownMap
from testbed.estimation.starting_path import another_start, likelier, what_is_lacking, with_more_rounds
from testbed.frame import Frame
from testbed.run.estimate import Estimate
from testbed.run.frame_store import FrameStore
from testbed.run.step_table import StepTable
from testbed.seeds import Stream


@dataclass
class Estimation:
    """Runs the filter frame by frame and keeps what the files of a run need."""

    config: FilterConfig
    seed: int | Stream
    threads: int | None = None
    """Threads of the filter; None = all cores. The result does not depend on it."""
    known_map: KnownMap | None = None
    """The map to localise in; None = a map is made."""
    mapper: GMapping | Localization = field(init=False)
    steps: StepTable = field(init=False)
    frames: FrameStore = field(init=False, default_factory=FrameStore)
    report: StepReport | None = field(init=False, default=None)
    """What happened at the last frame; None if it has no scan."""
    _online: list[Pose] = field(init=False, default_factory=list)
    """The pose that was reported at each scan, (3,) each."""
    _waiting: dict[str, tuple[Pose, Scan]] = field(init=False, default_factory=dict)
    """Newest scan of each lidar since the last update of the filter, with the odometry (3,) of its time."""

    def __post_init__(self) -> None:
        known = self.known_map
        if known is None:
            self.mapper = GMapping(self.config, seed=self.seed, threads=self.threads)
        else:
            self.mapper = Localization(
                known.grid, self.config, known.settings, start=known.start, seed=self.seed, threads=self.threads
            )
        self.steps = StepTable(aligned=known is None or not known.has_frame_of_truth)

    def process(self, frame: Frame) -> StepReport | None:
        """Process one frame; returns None if it has no scan.

        If a robot has several lidars, the newest unused scan of each other lidar goes to the filter too: the update
        gates would otherwise skip most of the lidars.
        """
        self.frames.append(frame)
        self.report = None
        if frame.scan is None:
            return None
        others = [_seen_from(frame, *seen) for name, seen in self._waiting.items() if name != frame.lidar]
        start = time.perf_counter()
        try:
            report = self.mapper.process(frame.odometry, [frame.scan, *others], twist=frame.twist)
        except BaseException:  # Ctrl-C within the filter: the frame was not taken in
            self.frames.drop_last()
            raise
        if report.updated:
            self._waiting.clear()
        else:
            self._waiting[frame.lidar] = frame.odometry, frame.scan
        seconds = time.perf_counter() - start
        best = self.mapper.best if isinstance(self.mapper, GMapping) else None
        self.steps.add(frame, report, seconds, self.mapper.poses, self.mapper.weights, best)
        self._online.append(report.pose)
        self.report = report
        return report

    @property
    def scan_frames(self) -> NDArray[np.intp]:
        """Indices of the frames with a scan, (scans,)."""
        return self.frames.with_scan

    @property
    def odometry(self) -> Pose:
        """`T_odom_robot` at every frame, joined where the odometry started again, (frames, 3)."""
        return join_odometry(self.frames.stamps, self.frames.odometry)

    @property
    def usable_range(self) -> float:
        """Readings beyond it are not used [m]."""
        return self.config.map.usable_range

    @property
    def stamps(self) -> NDArray[np.float64]:
        """Stamps of the frames [s], (frames,)."""
        return self.frames.stamps

    def trajectory_at_scans(self, source: Literal["odometry", "truth"]) -> Trajectory | None:
        """Return odometry or truth at every scan where it is known; None if it is known at no scan."""
        known = [
            (frame.stamp, pose)
            for frame in self.frames
            if frame.scan is not None and (pose := getattr(frame, source)) is not None
        ]
        if not known:
            return None
        stamps, poses = zip(*known, strict=True)
        return Trajectory(np.array(stamps), np.array(poses))

    def online(self) -> Trajectory:
        """Return the pose that was reported at each scan, when nothing later was known; needs at least one scan."""
        return Trajectory(self.stamps[self.scan_frames], np.array(self._online))

    def filtered(self) -> Estimate:
        """Return the path and map of the best particle; at least one scan is needed."""
        scan_frames = self.scan_frames
        updates = scan_frames[np.asarray(self.mapper.update_scans)]
        dense = between_updates(self.odometry, updates, self.mapper.path())
        return Estimate(dense=Trajectory(self.stamps, dense), scan_frames=scan_frames, map=self.mapper.map())

    def refined(self, estimate: Estimate, watch: Watch = unwatched) -> Estimate:
        """Return the estimate after the final pass over all frames, see `slam.refinement.refine`.

        Where the sensors see too little to carry a map, it is given more rounds. There, and where the scans do not tell
        how far the robot came, it is also made from a path that follows the odometry (`starting_path`).
        watch: is told how far the pass has come, and may end it early
        """
        config = with_more_rounds(self.config) if what_is_lacking(self.frames, self.config) else self.config
        path, notes = estimate.dense.poses, []
        result = self._refine(path, config, watch)
        if result.rounds < config.refine.rounds:
            notes.append(f"final pass: ended by hand after {result.rounds} of {config.refine.rounds} rounds")
        elif (other := another_start(result, path, self.odometry, self.frames, self.config)) is not None:
            results = result, self._refine(other.path, config, watch)
            updates = estimate.scan_frames[np.asarray(self.mapper.update_scans)]
            chosen = likelier(results, self.odometry, self.frames, updates, self.config)
            result = results[chosen]
            notes.append(other.note(chosen=chosen == 1))
        dense = Trajectory(self.stamps, result.poses)
        return Estimate(
            dense=dense,
            scan_frames=estimate.scan_frames,
            map=result.map,
            closing=result.closing,
            noise=noise_metrics(result),
            covariances=result.covariances,
            notes=tuple(notes),
        )

    def _refine(self, path: Pose, config: FilterConfig, watch: Watch) -> Refined:
        """Make the final pass from a path (frames, 3)."""
        return refine(
            self.odometry,
            self.frames.scans,
            path,
            config,
            twists=[frame.twist for frame in self.frames],
            stamps=self.stamps,
            threads=self.threads,
            watch=watch,
        )


def _seen_from(frame: Frame, odometry: Pose, scan: Scan) -> Scan:
    """Return an earlier scan, taken at `odometry` (3,), with its mount moved to the pose at the frame's time."""
    x, y, theta = se2.compose(se2.between(frame.odometry, odometry), scan.mount).tolist()
    return replace(scan, mount=(x, y, theta), stamp=frame.stamp)


CORRECTIONS = ("odometry_distance_correction", "odometry_rotation_correction", "odometry_drift_correction_rad_per_m")
"""Names of `Refined.odometry_correction` in `metrics.json`."""


def noise_metrics(result: Refined) -> dict[str, float]:
    """Standard deviations that the final pass found: the group `noise` of `metrics.json`, see docs/metrics.md."""
    floor, along, across, shared = np.sqrt(result.noise).tolist()
    position, heading = np.sqrt(result.odometry_variance).tolist()
    return {
        "reading_m": floor,
        "range_share": along,
        "angle_rad": across,
        "shared_by_scan_m": shared,
        "odometry_position_factor": position,
        "odometry_heading_factor": heading,
        **dict(zip(CORRECTIONS, result.odometry_correction.tolist(), strict=True)),
        **{f"{name}_sigma": s for name, s in zip(CORRECTIONS, result.odometry_correction_sigma.tolist(), strict=True)},
    }
