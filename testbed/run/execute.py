# SPDX-License-Identifier: MIT
"""One run: frames go through the system, the estimate is scored, all files are written."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from eval.estimates import PathAndMap, named, score_estimate
from eval.failure_cause import find_cause
from eval.files.failure_json import write_failure
from eval.first_failure import find_failure
from eval.map.lidar_view import LidarView
from eval.scoring import Reference, score
from slam.se2 import Pose, between
from slam.sensor.deskew import log_twist
from slam.sensor.rays import make_rays
from testbed.formats.commands import commands_of, write_commands
from testbed.formats.g2o import write_g2o
from testbed.frame import Frame
from testbed.run.covariances import covariance_metrics, write_covariances
from testbed.run.estimate import Estimate
from testbed.run.followed import Following
from testbed.run.interruption import deferred_interruption
from testbed.run.job import Job
from testbed.run.loop_metrics import loop_metrics, loops_to_show
from testbed.run.mount_metrics import find_mount, mount_metrics, mount_notes
from testbed.run.run_directory import RunDirectory, result_hash
from testbed.views import NullView, View


class RunProgress(Protocol):
    """Shows the progress of a run, such as a progress line."""

    def stage(self, text: str) -> None:
        """Show that a new stage of the job begins."""
        ...

    def step(self, stamp: float, share: float | None, error: float | None) -> None:
        """Show that one scan is done.

        stamp: that of the scan [s]; share: the part of the job that is done, None = unknown; error: of the position
        [m], None = unknown
        """
        ...

    def share(self, done: float) -> None:
        """Show which part of the stage is done, 0 to 1."""
        ...


def execute_job(job: Job, directory: RunDirectory, watcher: RunProgress, view: View | None = None) -> dict[str, Any]:
    """Run the job, write all files except the report, and return the content of `metrics.json`.

    Ctrl-C ends the run after the current frame: the outcome is `interrupted`, and the estimate so far is kept. After
    any other exception the outcome is `failed`, and the exception is raised again.
    """
    with directory.marked():
        directory.write_config(job.document)
        return _execute(job, directory, watcher, view if view is not None else NullView())


def _execute(job: Job, directory: RunDirectory, watcher: RunProgress, view: View) -> dict[str, Any]:
    started = time.perf_counter()
    system = job.system
    watcher.stage("mapping" if system.makes_map else "localising")
    system.start((), job.seed)
    estimation = system.following()
    with _estimate_kept(job, directory, estimation), view:
        interrupted = _feed(job, estimation, watcher, view)
        if not len(estimation.scan_frames):
            metrics = {"outcome": "interrupted" if interrupted else "failed", "reason": "no scan", "scans": 0}
            directory.write_metrics(metrics)
            return metrics
        filtered = estimation.filtered()
        estimate = filtered
        if system.refines and not interrupted:
            watcher.stage("final pass")
            try:
                estimate, interrupted = _refined(estimation, filtered, watcher)
                loops = loops_to_show(estimate.closing, filtered.dense.poses, estimate.dense.poses)
                view.finish(estimate.at_scans.poses, estimate.map, loops)
            except KeyboardInterrupt:
                interrupted = True
        wall_seconds = time.perf_counter() - started  # of the estimate; writing and scoring it are no part of that
    watcher.stage("scoring")
    _write(job, directory, estimation, filtered, estimate)
    ended = "interrupted" if interrupted else job.source.ended
    metrics = metrics_of(job, filtered, estimate, wall_seconds=wall_seconds, ended=ended)
    directory.write_metrics(metrics)
    return metrics


def _refined(estimation: Following, filtered: Estimate, watcher: RunProgress) -> tuple[Estimate, bool]:
    """Return the estimate after the final pass, and whether the user has ended that early."""
    with deferred_interruption() as interruption:

        def watch(share: float) -> bool:
            watcher.share(share)
            return not interruption.requested

        return estimation.refined(filtered, watch), interruption.requested


@contextmanager
def _estimate_kept(job: Job, directory: RunDirectory, estimation: Following) -> Iterator[None]:
    """Write what the system has estimated so far if an exception ends the block."""
    try:
        yield
    except Exception:
        if len(estimation.scan_frames):
            with suppress(Exception):  # the first error is the one to report
                filtered = estimation.filtered()
                _write(job, directory, estimation, filtered, filtered)
        raise


def _feed(job: Job, estimation: Following, watcher: RunProgress, view: View) -> bool:
    """Process all frames; returns whether the user interrupted it."""
    system = job.system
    with deferred_interruption() as interruption:
        for frame in job.source:
            system.process(frame)
            if estimation.report is not None:
                job.source.observe(frame, estimation.report, system.map)
                view.show(system.snapshot(frame, collided=job.source.collided))
                watcher.step(frame.stamp, job.source.share_done, estimation.steps.last_error)
            if interruption.requested:
                return True
    return False


def _write(job: Job, directory: RunDirectory, estimation: Following, filtered: Estimate, estimate: Estimate) -> None:
    """Write all files except metrics and report."""
    directory.write_trajectory("estimate.tum", estimate.at_scans)
    directory.write_trajectory("estimate_dense.tum", estimate.dense)
    directory.write_trajectory("online.tum", estimation.online())
    if estimate is not filtered:
        directory.write_trajectory("filter.tum", filtered.at_scans)
    if estimate.closing is not None:
        write_g2o(directory / "graph.g2o", estimate.closing.nodes, estimate.closing.accepted_edges)
    if estimate.covariances is not None:
        at_scans = estimate.covariances[estimate.scan_frames]
        write_covariances(directory / "estimate_covariance.parquet", estimate.at_scans, at_scans)
    for name in ("odometry", "truth"):
        trajectory = estimation.trajectory_at_scans(name)
        if trajectory is not None:
            directory.write_trajectory(f"{name}.tum", trajectory)
    if commands := commands_of(estimation.frames):
        write_commands(directory / "commands.csv", commands)
    directory.write_map("map", estimate.map)
    if job.truth_map is not None:
        directory.write_map("truth_map", job.truth_map)
    estimation.steps.write(directory / "steps.parquet")
    _write_failure(job, directory, estimation, estimate, refined=estimate is not filtered)


def _write_failure(
    job: Job, directory: RunDirectory, estimation: Following, estimate: Estimate, *, refined: bool
) -> None:
    """Write where it went wrong, with the scan that shows it; nothing where there is nothing to judge by."""
    truth, steps = estimation.trajectory_at_scans("truth"), estimation.steps.columns()
    failure = find_failure(estimate.at_scans, truth=truth, relations=job.relations, dense=estimate.dense, steps=steps)
    if failure is None:
        return
    if failure.bad:
        odometry = estimation.trajectory_at_scans("odometry")
        cause = find_cause(
            failure.stamp,
            odometry=odometry,
            reference=truth,
            steps=steps,
            estimate=estimate.at_scans,
            refined=refined,
        )
        failure = replace(failure, cause=cause)
    row = int(estimate.scan_frames[failure.shown_scan])
    frame = estimation.frames[row]
    assert frame.scan is not None
    twist = true_twist(estimation.frames, row)
    rays = make_rays([frame.scan], usable_range=estimation.usable_range, twist=frame.twist if twist is None else twist)
    write_failure(directory / "finding.json", failure, rays.ends)


def true_twist(frames: Sequence[Frame], row: int) -> Pose | None:
    """Velocity (vx, vy, omega) [m/s, m/s, rad/s] of the robot while a frame's scan was taken, by the truth.

    The wheels' own twist lays a scan out wrongly where they slip, which is just where one looks. None where the truth
    is unknown.
    """
    frame = frames[row]
    offsets = None if frame.scan is None else frame.scan.time_offsets
    end = frame.stamp + (float(np.nanmax(offsets)) if offsets is not None and len(offsets) else 0.0)
    later = row
    while later + 1 < len(frames) and (later == row or frames[later].stamp < end):
        later += 1
    start, stop = frame.truth, frames[later].truth
    if start is None or stop is None or frames[later].stamp <= frame.stamp:
        return None
    return log_twist(between(start, stop), frames[later].stamp - frame.stamp)


def metrics_of(
    job: Job, filtered: Estimate, estimate: Estimate, *, wall_seconds: float, ended: str | None
) -> dict[str, Any]:
    """Return the content of `metrics.json`: all measures of the three estimates (`eval.estimates`), ready for JSON.

    job: its system has processed the frames. filtered: the filter's path and map. estimate: the final one, the same
    object where there was no final pass.
    wall_seconds: time that the estimate took. ended: why the run did not end by itself, see `eval.outcome.judge`.
    """
    system, estimation = job.system, job.system.following()
    reference = Reference(
        trajectory=estimation.trajectory_at_scans("truth"),
        relations=job.relations,
        grid=job.truth_map,
        walls=job.truth_walls,
        lidars=job.lidars or lidar_views(estimation.frames),
        observable=job.observable,
        aligns_map=job.aligns_map,
    )
    # Ctrl-C must end soon, and scoring a map takes long; a map that was given is not a result of the run
    scores_map = ended != "interrupted" and system.makes_map
    metrics = score(
        estimate.at_scans,
        reference=reference,
        odometry=estimation.trajectory_at_scans("odometry"),
        dense=estimate.dense,
        grid=estimate.map if scores_map else None,
        steps=estimation.steps.columns(),
        ended=ended,
        facts={
            **system.own_metrics(estimate, replay=job.checks_by_replay and ended != "interrupted"),
            "seed": job.seed,
            "refined": estimate is not filtered,
            "wall_s": wall_seconds,
            "peak_rss_mb": peak_memory_mb(),
            "result_hash": result_hash(estimate.at_scans, estimate.map),
        },
    )
    metrics |= score_estimate("online", PathAndMap(at_scans=estimation.online()), reference, ended)
    if estimate is filtered:
        metrics |= named("filter", metrics)
    else:
        path = PathAndMap(at_scans=filtered.at_scans, dense=filtered.dense, map=filtered.map if scores_map else None)
        metrics |= score_estimate("filter", path, reference, ended)
    if estimate.closing is not None:
        metrics["loops"] = loop_metrics(estimate.closing, filtered.dense, reference.trajectory)
    if estimate.noise is not None:
        metrics["noise"] = estimate.noise
    if estimate.covariances is not None:
        truth = [frame.truth for frame in estimation.frames]
        metrics["covariance"] = covariance_metrics(estimate.covariances, estimate.dense.poses, truth)
    mount = None if estimate is filtered else find_mount(estimation.frames, estimation.odometry, estimate.dense.poses)
    if mount is not None:
        metrics["mount"] = mount_metrics(mount)
    metrics["notes"] = [
        *system.notes,
        *job.notes,
        *estimate.notes,
        *([] if mount is None else mount_notes(mount)),
        *metrics["notes"],
    ]
    return {**metrics, **system.last_word(estimate, ended)}


def lidar_views(frames: Sequence[Frame]) -> tuple[LidarView, ...]:
    """Return the view of each lidar that took a scan with a beam, in the order in which they appear."""
    lidars = dict.fromkeys(frame.lidar for frame in frames if frame.scan is not None and len(frame.scan.angles))
    return tuple(
        LidarView.of(frame.scan for frame in frames if frame.scan is not None and frame.lidar == lidar)
        for lidar in lidars
    )


def peak_memory_mb() -> float:
    """Return the largest resident set of this process so far [MB]."""
    unit = 1 if sys.platform == "darwin" else 1024  # macOS counts bytes, Linux kibibytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
