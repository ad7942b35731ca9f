# SPDX-License-Identifier: MIT
"""Gives the frames of a recording to a system, checks what it returns, and measures what it costs."""

from __future__ import annotations

import os
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.motion.continuous_odometry import join_odometry
from slam.motion.interpolation import interpolate_with_odometry
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.systems.errors import SystemFailedError
from testbed.systems.finding import describe
from testbed.systems.memory import peak_memory
from testbed.systems.particles import KeptParticles
from testbed.systems.protocol import System, lidars_of
from testbed.systems.time_limit import TimeLimitError, time_limit
from testbed.views.schedule import shown_scans

MAX_GAP = 1.0
"""Poses at other times than those of the frames are interpolated where two of them are this close [s]."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Estimated:
    """The path and the map of a system on a recording; poses are `T_map_robot`."""

    dense: Trajectory
    """Poses at the frames from the first to the last known pose, in the order of the recording."""
    frames: NDArray[np.intp]
    """Numbers of these frames in the recording, (poses,)."""
    at_scans: NDArray[np.intp]
    """Rows of `dense` whose frames have a scan, (scans,)."""
    grid: OccupancyGrid | None
    """The map; None = the system has none."""
    online: Trajectory | None = None
    """The pose while driving at each scan from the first reported pose on; None where none was reported."""
    notes: tuple[str, ...] = ()
    """What a reader of the results must know."""
    particles: KeptParticles = field(default_factory=KeptParticles)
    """The particles while driving, at the scans that a recording shows; empty where the system has none."""

    def __repr__(self) -> str:
        """One line, for notebooks."""
        rows, cols = self.grid.probability.shape if self.grid is not None else (0, 0)
        words = "no map" if self.grid is None else f"a map of {cols} x {rows} cells of {self.grid.resolution:g} m"
        length = float(self.dense.distance[-1])
        return f"<Estimated: poses at {len(self.at_scans)} scans over {length:.1f} m, {words}>"


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What a system took to process a recording."""

    wall_s: float
    """Time that is spent in the system [s]."""
    cpu_s: float | None = None
    """Time of all cores [s]; None = unknown."""
    ms_per_scan: float | None = None
    """`wall_s` by the number of scans [ms]."""
    ms_per_scan_p95: float | None = None
    """95th percentile of the time in which one scan is processed, without what comes after the last [ms]."""
    finish_s: float | None = None
    """Time after the last scan, such as that of a final pass [s]."""
    memory_mb: float | None = None
    """Largest memory that the system takes [MB]; None = unknown."""


FORKED = 70
"""Exit status of a copy of the process that a system has let go on."""
MIN_ON_MAP = 0.5
"""A smaller share of the path within the known part of the map adds a note."""
Step = Callable[[Frame], None]
"""Is called after each frame with a scan."""


def feed(
    system: System,
    label: str,
    frames: Sequence[Frame],
    seed: int,
    step: Step | None = None,
    *,
    seconds: float | None = None,
) -> tuple[Estimated, Cost]:
    """Give all frames to a system and return what it estimated and what it cost.

    seconds: which one call of a method may take at most, see `testbed.systems.time_limit`; None = no limit

    Raises SystemFailedError, whose message begins with `label`, where the system raises an exception, hangs, returns
    something else than the protocol says, or nothing at all.
    """
    lidars = lidars_of(frames)
    if not lidars:
        raise SystemFailedError(f"{label}: the recording has no scan with beams, expected at least one")
    poses = np.full((len(frames), 3), np.nan)
    took: list[float] = []
    particles, shown_at = KeptParticles(), set(shown_scans(sum(frame.scan is not None for frame in frames)).tolist())
    whole, scan, since_scan = _Clock(), -1, _Clock()
    with peak_memory() as memory:
        with whole, _blamed(label, "start", "preparation for the recording", seconds):
            system.start(lidars, seed)
        for row, frame in enumerate(frames):
            scan += frame.scan is not None
            shown, place = shown_to_systems(frame), f"{label}: {_place(scan, frame)}"
            with whole, since_scan, _blamed(place, "process", "a pose or None", seconds):
                pose = system.process(shown)
            if pose is not None:
                poses[row] = _checked_pose(pose, place)
            if frame.scan is not None:
                took.append(since_scan.wall)
                since_scan = _Clock()
                if scan in shown_at:
                    particles.add(scan, system, place)
                if step is not None:
                    step(frame)
        last = _Clock()
        expected = "(trajectory or None, map or None)"
        with whole, last, _blamed(f"{label}: after scan {scan}", "finish", expected, seconds):
            result = system.finish()
        trajectory, grid = _checked_result(result, label)
    estimated = replace(_estimated(label, frames, poses, trajectory, grid), particles=particles)
    cost = Cost(
        wall_s=whole.wall,
        cpu_s=whole.cpu,
        ms_per_scan=1e3 * whole.wall / len(took),
        ms_per_scan_p95=1e3 * float(np.percentile(took, 95.0)),
        finish_s=last.wall,
        memory_mb=memory.megabytes,
    )
    return estimated, cost


class _Clock:
    """Sums the time that is spent in its blocks [s], by the clock and of all cores."""

    def __init__(self) -> None:
        self.wall = self.cpu = 0.0

    def __enter__(self) -> None:
        self._began = time.perf_counter(), time.process_time()

    def __exit__(self, *_: object) -> None:
        self.wall += time.perf_counter() - self._began[0]
        self.cpu += time.process_time() - self._began[1]


def shown_to_systems(frame: Frame) -> Frame:
    """Return the frame without the truth, with arrays of its own, which a system may change."""
    scan = frame.scan
    if scan is not None:
        times = None if scan.time_offsets is None else scan.time_offsets.copy()
        scan = replace(scan, ranges=scan.ranges.copy(), angles=scan.angles.copy(), time_offsets=times)
    twist = None if frame.twist is None else frame.twist.copy()
    return replace(frame, odometry=frame.odometry.copy(), twist=twist, scan=scan, truth=None)


def estimated_from(
    label: str, frames: Sequence[Frame], trajectory: Trajectory, grid: OccupancyGrid | None
) -> Estimated:
    """Return the poses of a trajectory at the frames between its first and its last pose.

    Between two poses at stamps of frames the odometry leads on; poses at other stamps are interpolated in a straight
    line. Raises SystemFailedError where they are out of order, or nowhere near the frames.
    """
    stamps = np.array([frame.stamp for frame in frames])
    rows = rows_of(trajectory.stamps, stamps)
    if rows is None:
        return _interpolated(label, frames, stamps, trajectory, grid)
    back = np.flatnonzero(np.diff(rows) <= 0)
    if len(back):
        at = int(back[0]) + 1
        raise SystemFailedError(
            f"{label}: the trajectory's pose {at} at {trajectory.stamps[at]:.3f} s comes after that at "
            f"{trajectory.stamps[at - 1]:.3f} s, expected the order of the frames, each at most once"
        )
    return _carried(label, frames, rows, trajectory.poses, grid)


def rows_of(stamps: NDArray[np.float64], of_frames: NDArray[np.float64]) -> NDArray[np.intp] | None:
    """Return the frame of each stamp, (n,); None where one is that of no frame.

    Stamps of recordings may repeat and step backwards: of several frames with one stamp the first that lies behind the
    one before is meant.
    """
    if np.array_equal(stamps, of_frames):
        return np.arange(len(stamps))
    places: dict[float, list[int]] = {}
    for row, stamp in enumerate(of_frames.tolist()):
        places.setdefault(round(stamp, 6), []).append(row)
    rows, last = [], -1
    for stamp in stamps.tolist():
        found = places.get(round(stamp, 6))
        if found is None:
            return None
        behind = bisect_right(found, last)
        last = found[behind] if behind < len(found) else found[0]
        rows.append(last)
    return np.array(rows, dtype=np.intp)


@contextmanager
def _blamed(label: str, method: str, expected: str, seconds: float | None) -> Iterator[None]:
    """Name the system, the place and what was expected in the error of a system, also where it takes too long [s].

    A copy of this process that a system has forked and let return ends here: it would write over the run's files.
    """
    own = os.getpid()
    try:
        with time_limit(seconds):
            yield
        if os.getpid() != own:
            os._exit(FORKED)
    except SystemFailedError:
        raise
    except TimeLimitError:
        raise SystemFailedError(
            f"{label}: {method} did not return within the time limit of {seconds:g} s, expected {expected}"
        ) from None
    except (Exception, SystemExit) as error:  # sys.exit of a system must not end the others
        raise SystemFailedError(f"{label}: {method} raised {describe(error)}, expected {expected}") from error


def _place(scan: int, frame: Frame) -> str:
    at = "before the first scan" if scan < 0 else f"scan {scan}" if frame.scan is not None else f"after scan {scan}"
    return f"{at} ({frame.stamp:.3f} s)"


def _checked_pose(pose: object, label: str) -> Pose:
    expected = "expected a pose (x, y, theta) of three finite numbers, or None"
    try:
        values = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        raise SystemFailedError(f"{label}: process returned {_shortly(pose)}, {expected}") from None
    if values.shape != (3,):
        raise SystemFailedError(f"{label}: process returned an array of shape {values.shape}, {expected}")
    if not np.isfinite(values).all():
        raise SystemFailedError(f"{label}: process returned {tuple(values.tolist())}, {expected}")
    return values


def _checked_result(result: object, label: str) -> tuple[Trajectory | None, OccupancyGrid | None]:
    expected = "expected (Trajectory or None, OccupancyGrid or None)"
    if not isinstance(result, tuple) or len(result) != 2:
        raise SystemFailedError(f"{label}: finish returned {_shortly(result)}, {expected}")
    trajectory, grid = result
    if trajectory is not None and not isinstance(trajectory, Trajectory):
        raise SystemFailedError(f"{label}: finish returned a {type(trajectory).__name__} as trajectory, {expected}")
    if grid is not None and not isinstance(grid, OccupancyGrid):
        raise SystemFailedError(f"{label}: finish returned a {type(grid).__name__} as map, {expected}")
    if grid is not None:
        known = grid.probability[grid.known]
        if len(known) and not ((known >= 0.0) & (known <= 1.0)).all():
            raise SystemFailedError(
                f"{label}: the map holds {known.min():g} to {known.max():g}, expected probabilities in [0, 1], NaN = "
                "unknown"
            )
        if not np.isfinite([grid.resolution, *grid.origin]).all():
            raise SystemFailedError(f"{label}: the map's origin is {grid.origin}, expected three finite numbers")
    return trajectory, grid


def _shortly(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}…"


def _estimated(
    label: str, frames: Sequence[Frame], poses: Pose, trajectory: Trajectory | None, grid: OccupancyGrid | None
) -> Estimated:
    """Put together what a system reported while driving, poses (frames, 3) with NaN for None, and at the end."""
    reported = np.flatnonzero(np.isfinite(poses[:, 0]))
    if trajectory is None and not len(reported):
        raise SystemFailedError(f"{label}: returned no pose, neither from process nor from finish, expected some")
    online = _online(frames, reported, poses) if len(reported) else None
    if trajectory is not None:
        found = estimated_from(label, frames, trajectory, grid)
    else:
        found = _carried(label, frames, reported, poses[reported], grid)
    return replace(found, online=online)


def _odometry(frames: Sequence[Frame]) -> Pose:
    """`T_odom_robot` at every frame, joined where the odometry started again, (frames, 3)."""
    stamps = np.array([frame.stamp for frame in frames])
    joined: Pose = join_odometry(stamps, np.array([frame.odometry for frame in frames]))
    return joined


def _online(frames: Sequence[Frame], reported: NDArray[np.intp], poses: Pose) -> Trajectory | None:
    """The pose at each scan as it was known then: the last that was reported, moved on by the odometry."""
    scans = np.flatnonzero([frame.scan is not None for frame in frames])
    scans = scans[scans >= reported[0]]
    if not len(scans):
        return None
    last = reported[np.searchsorted(reported, scans, side="right") - 1]
    odometry = _odometry(frames)
    at_scans = se2.compose(poses[last], se2.between(odometry[last], odometry[scans]))
    same = last == scans
    at_scans[same] = poses[scans[same]]  # to the bit
    return Trajectory(np.array([frames[row].stamp for row in scans]), at_scans)


def _carried(
    label: str, frames: Sequence[Frame], rows: NDArray[np.intp], poses: Pose, grid: OccupancyGrid | None
) -> Estimated:
    """Poses at the frames from the first to the last of `rows`, carried by the odometry in between."""
    covered = np.arange(rows[0], rows[-1] + 1)
    dense = poses
    if len(covered) > len(rows):
        dense = interpolate_with_odometry(_odometry(frames)[covered], rows - rows[0], poses)
    return _with_scans(label, frames, covered, dense, grid, ())


def _interpolated(
    label: str, frames: Sequence[Frame], stamps: NDArray[np.float64], trajectory: Trajectory, grid: OccupancyGrid | None
) -> Estimated:
    """Poses at the frames between two poses of a trajectory with stamps of its own."""
    back = np.flatnonzero(np.diff(trajectory.stamps) <= 0.0)
    if len(back):
        at = int(back[0]) + 1
        raise SystemFailedError(
            f"{label}: the trajectory's pose {at} at {trajectory.stamps[at]:.3f} s comes after that at "
            f"{trajectory.stamps[at - 1]:.3f} s, expected increasing stamps, or those of the frames in their order"
        )
    after = np.searchsorted(trajectory.stamps, stamps)
    inside = (after > 0) & (after < len(trajectory))
    near = inside.copy()
    near[inside] = np.diff(trajectory.stamps)[after[inside] - 1] <= MAX_GAP
    covered = np.flatnonzero(near)
    if not len(covered):
        raise SystemFailedError(
            f"{label}: the trajectory's stamps ({trajectory.stamps[0]:.3f} to {trajectory.stamps[-1]:.3f} s) bracket "
            f"no frame ({stamps.min():.3f} to {stamps.max():.3f} s), expected the clock of the recording"
        )
    later, earlier = after[covered], after[covered] - 1
    first, second = trajectory.poses[earlier], trajectory.poses[later]
    span = trajectory.stamps[later] - trajectory.stamps[earlier]
    share = ((stamps[covered] - trajectory.stamps[earlier]) / span)[:, None]
    poses = first + share * np.column_stack([second[:, :2] - first[:, :2], se2.wrap_angle(second[:, 2] - first[:, 2])])
    note = "the trajectory's stamps are not those of the frames: it was interpolated in a straight line"
    return _with_scans(label, frames, covered, poses, grid, (note,))


def _with_scans(
    label: str,
    frames: Sequence[Frame],
    covered: NDArray[np.intp],
    poses: Pose,
    grid: OccupancyGrid | None,
    notes: tuple[str, ...],
) -> Estimated:
    dense = Trajectory(np.array([frames[row].stamp for row in covered]), poses)
    at_scans = np.flatnonzero([frames[row].scan is not None for row in covered])
    if not len(at_scans):
        raise SystemFailedError(f"{label}: its poses cover no scan, expected a pose at a scan at least")
    return Estimated(
        dense=dense, frames=covered, at_scans=at_scans, grid=grid, notes=(*notes, *_frame_notes(poses, grid))
    )


def _frame_notes(poses: Pose, grid: OccupancyGrid | None) -> tuple[str, ...]:
    """A note where most of the path lies beyond the known part of the map: the two are then in different frames."""
    if grid is None or not grid.known.any():
        return ()
    cells = np.floor(se2.between(np.asarray(grid.origin), poses)[:, :2] / grid.resolution)
    rows, cols = np.flatnonzero(grid.known.any(axis=1)), np.flatnonzero(grid.known.any(axis=0))
    low, high = np.array([cols[0], rows[0]]), np.array([cols[-1], rows[-1]])
    share = float(np.mean(np.all((cells >= low) & (cells <= high), axis=1)))
    if share >= MIN_ON_MAP:
        return ()
    return (
        f"only {share:.0%} of the path lies within the known part of the map, expected both in one frame (T_map_robot, "
        "and the map's origin = its lower left corner)",
    )
