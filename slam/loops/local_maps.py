# SPDX-License-Identifier: MIT
"""Local maps: stretches of the recording that are mapped without memory of what was seen before.

A filter that comes back to a place with an error matches its scans to walls that lie wrong, and its path bends. Here
each scan is matched to a map of the last metres alone: two maps grow at a time, one begun half a length after the
other, scans go into both and are matched in the older (the submaps of Hess, Kohler, Rapp, Andor, "Real-Time Loop
Closure in 2D LIDAR SLAM", ICRA 2016). The path drifts slowly, but nothing ever tears it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig
from slam.grid.particle_maps import ParticleMaps
from slam.matching.likelihood import ScanAndPrior, make_beam_model
from slam.matching.scan_matching import empty_matches, make_match_settings, match_scan
from slam.motion.odometry_model import motion_prior
from slam.sensor.rays import Rays
from slam.step.scan_intake import gate_opens

LENGTH = 12.0
"""Driven length of a local map [m]: a room or a stretch of corridor, over which matching hardly drifts."""
MIN_MATCHED_SHARE = 0.5
"""Where a smaller share of the hits meets a wall, the match has failed: the robot may have moved in any way that the
motion model allows. On recorded logs 99 % of the good matches have more than 0.65."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalMap:
    """The map of one stretch, seen from the robot's pose in the middle of it."""

    anchor: int
    """Number of the scan in the track from which the map is seen."""
    walls: NDArray[np.float64]
    """Centres of the occupied cells [m], (n, 2)."""
    states: NDArray[np.int8]
    """Cells in the frame of the track, (rows, columns): 1 wall, -1 free, 0 never seen."""
    origin: NDArray[np.float64]
    """Pose of the outer corner of cell (0, 0), seen from the anchor, (3,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The path along the local maps, and the maps."""

    frames: NDArray[np.int64]
    """Frames whose scans were used, (scans,)."""
    poses: se2.Pose
    """Poses in a frame that drifts, (scans, 3); the first is the origin."""
    covariances: NDArray[np.float64]
    """Covariances of the matches, seen from the robot, (scans, 3, 3)."""
    distance: NDArray[np.float64]
    """Distance driven up to each scan [m], (scans,)."""
    maps: list[LocalMap]
    """In the order in which they were begun."""

    @property
    def anchors(self) -> NDArray[np.int64]:
        """Numbers of the scans from which the maps are seen, (maps,)."""
        return np.array([local.anchor for local in self.maps], dtype=np.int64)


def track_locally(
    odometry: se2.Pose, path: se2.Pose, rays: Mapping[int, Rays], config: FilterConfig, threads: Threads
) -> Track:
    """Follow the robot through a recording by local maps.

    odometry (frames, 3);  path (frames, 3): an estimate whose steps are a second guess;  rays of the frames with a hit
    """
    tracker = _Tracker(config, threads)
    for frame, ray in rays.items():
        tracker.add(frame, odometry[frame], path[frame], ray)
    return tracker.finish()


class _Growing:
    """A local map while it grows."""

    def __init__(self, begin: int, distance: float, config: FilterConfig, threads: Threads) -> None:
        self.begin, self.distance = begin, distance
        self.maps = ParticleMaps(1, config.map, threads)


class _Tracker:
    def __init__(self, config: FilterConfig, threads: Threads) -> None:
        self._config, self._threads = config, threads
        self._frames: list[int] = []
        self._poses: list[se2.Pose] = []
        self._covariances: list[NDArray[np.float64]] = []
        self._distance: list[float] = []
        self._odometry, self._estimate = np.zeros(3), np.zeros(3)
        self._growing: list[_Growing] = []
        self._finished: list[LocalMap] = []

    def add(self, frame: int, odometry: se2.Pose, estimate: se2.Pose, rays: Rays) -> None:
        """Match the scan of one frame if the robot has moved far enough, and draw it into the maps that grow."""
        motion, moved = se2.between(self._odometry, odometry), se2.between(self._estimate, estimate)
        if not self._frames:
            self._note(frame, np.zeros(3), np.zeros((3, 3)), 0.0)
        elif gate_opens(self._config.gate, motion, 0.0) or gate_opens(self._config.gate, moved, 0.0):
            pose, covariance = self._match(motion, moved, np.ascontiguousarray(rays.ends[rays.hit]))
            self._note(frame, pose, covariance, float(np.hypot(motion[0], motion[1])))
        else:
            return
        self._odometry, self._estimate = odometry, estimate
        self._begin_and_finish()
        for growing in self._growing:
            growing.maps.integrate_scan(self._poses[-1][None], rays)

    def finish(self) -> Track:
        """The track, with what still grows."""
        if self._growing:
            self._finish(self._growing[0])
        return Track(
            frames=np.array(self._frames),
            poses=np.array(self._poses),
            covariances=np.array(self._covariances),
            distance=np.array(self._distance),
            maps=self._finished,
        )

    def _note(self, frame: int, pose: se2.Pose, covariance: NDArray[np.float64], moved: float) -> None:
        self._frames.append(frame)
        self._poses.append(pose)
        self._covariances.append(covariance)
        self._distance.append((self._distance[-1] if self._distance else 0.0) + moved)

    def _match(
        self, motion: se2.Pose, moved: se2.Pose, hits: NDArray[np.float64]
    ) -> tuple[se2.Pose, NDArray[np.float64]]:
        """Pose (3,) of a scan in the older map, and the covariance (3, 3) of the match, seen from the robot."""
        cfg = self._config
        guess = se2.compose(self._poses[-1], motion)
        scan_and_prior = ScanAndPrior(hits, make_beam_model(cfg.match, cfg.map), motion_prior(motion, cfg.motion))
        out = empty_matches(1)
        settings = make_match_settings(motion, hits, cfg)
        settings = settings._replace(starts=np.vstack([settings.starts, se2.between(motion, moved)]))
        older = self._growing[0].maps
        match_scan(older, guess[None], scan_and_prior, settings, weights=np.ones(1), u=np.zeros(1), out=out)
        if out.matched[0] < MIN_MATCHED_SHARE:
            return out.optimum[0].copy(), np.diag(1.0 / scan_and_prior.prior.precision[2])
        factor = np.linalg.inv(np.tril(out.factor[0]))
        turn = se2.rotation(-out.optimum[0, 2])
        return out.optimum[0].copy(), turn @ (factor.T @ factor) @ turn.T

    def _begin_and_finish(self) -> None:
        """Begin a map each half length; finish one after a length."""
        now, scan = self._distance[-1], len(self._frames) - 1
        if self._growing and now - self._growing[0].distance >= LENGTH:
            self._finish(self._growing.pop(0))
        if not self._growing or now - self._growing[-1].distance >= 0.5 * LENGTH:
            self._growing.append(_Growing(scan, now, self._config, self._threads))

    def _finish(self, growing: _Growing) -> None:
        grid = growing.maps.occupancy(0)
        anchor = (growing.begin + len(self._frames) - 1) // 2
        states = grid.occupied.astype(np.int8) - grid.free.astype(np.int8)
        origin = se2.between(self._poses[anchor], np.array(grid.origin))
        rows, columns = np.nonzero(grid.occupied)
        walls = se2.transform_points(origin, np.column_stack([columns + 0.5, rows + 0.5]) * grid.resolution)
        self._finished.append(LocalMap(anchor=anchor, walls=walls, states=states, origin=origin))
