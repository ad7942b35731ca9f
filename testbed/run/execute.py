# SPDX-License-Identifier: MIT
"""One run: frames go through the filter into a run directory, scored, with a view of it beside."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from eval.files.failure_json import write_finding
from eval.first_failure import find
from eval.scoring import Reference, score
from eval.trajectory.relations import Relations
from slam.config import FilterConfig
from slam.gmapping import GMapping
from slam.localization import Localization
from slam.occupancy import OccupancyGrid
from slam.sensor.rays import make_rays
from slam.step.step_report import StepReport
from testbed.formats.commands import commands_of, write_commands
from testbed.frame import Frame
from testbed.lidar_views import lidar_views
from testbed.run.estimation import Estimate, Estimation
from testbed.run.interruption import deferred_interruption
from testbed.run.known_map import KnownMap, localization_metrics, why_astray
from testbed.run.run_directory import RunDirectory, result_hash
from testbed.simulation import Simulation
from testbed.views import NullView, Snapshot, View


class Watcher(Protocol):
    """Who is told how the run goes, such as a progress line."""

    def stage(self, text: str) -> None:
        """A new stage of the job begins."""
        ...

    def step(self, stamp: float, share: float | None, error: float | None) -> None:
        """One scan is done: its stamp [s], the share of the job behind us, the position error where known [m]."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """What a run needs besides the place it writes to."""

    frames: Iterable[Frame]
    """What the sensors said."""
    document: Mapping[str, Any]
    """Content of `config.toml`."""
    seed: int
    """The run's seed, as `metrics.json` states it."""
    filter: FilterConfig
    """Settings of the filter."""
    filter_seed: np.random.SeedSequence
    """Seed of the filter's random numbers."""
    threads: int | None = None
    """Threads of the filter; None = all cores. Results do not depend on it."""
    known_map: KnownMap | None = None
    """The map to localise in; None = the map is to be made."""
    refine: bool = True
    """Whether the final pass over all frames is made."""
    truth_map: OccupancyGrid | None = None
    """The true map: 1 occupied, 0 free, NaN not visible to any lidar."""
    relations: Relations | None = None
    """Hand-checked relations between poses."""
    share_done: Callable[[], float | None] = lambda: None
    """How much of the job is behind us, in [0, 1]; None = unknown."""
    observe: Callable[[Frame, StepReport, GMapping], None] = lambda frame, report, mapper: None
    """Told what the mapper made of each scan, before the next frame is asked for: how it steers a robot."""
    collided: Callable[[], bool] = lambda: False
    """Whether the robot has touched something."""
    ended: Callable[[], str | None] = lambda: None
    """Why the drive did not end as planned, asked after the last frame: `collided`, `timeout`; None = it did."""


def execute(job: Job, directory: RunDirectory, watcher: Watcher, view: View | None = None) -> dict[str, Any]:
    """Run the job, write all files but the report, return what is in `metrics.json`.

    Ctrl-C ends the run after the frame at hand: the outcome is `interrupted`, and what was there is kept. If anything
    else breaks, the outcome is `failed` and the exception goes on to the caller.
    """
    with directory.marked():
        directory.write_config(job.document)
        return _execute(job, directory, watcher, view if view is not None else NullView())


def _execute(job: Job, directory: RunDirectory, watcher: Watcher, view: View) -> dict[str, Any]:
    started = time.perf_counter()
    watcher.stage("mapping" if job.known_map is None else "localising")
    estimation = Estimation(job.filter, job.filter_seed, job.threads, job.known_map)
    with view:
        interrupted = _feed(job, estimation, watcher, view)
        if not len(estimation.scan_frames):
            metrics = {"outcome": "interrupted" if interrupted else "failed", "reason": "no scan", "scans": 0}
            directory.write_metrics(metrics)
            return metrics
        filtered = estimation.filtered()
        estimate = filtered
        if job.refine and job.known_map is None and not interrupted:
            watcher.stage("final pass")
            try:
                estimate = estimation.refined(filtered)
                view.finish(estimate.at_scans.poses, estimate.map)
            except KeyboardInterrupt:
                interrupted = True
        wall_seconds = time.perf_counter() - started  # of the estimate; writing and scoring it are no part of that
    watcher.stage("scoring")
    _write(job, directory, estimation, filtered, estimate)
    ended = "interrupted" if interrupted else job.ended()
    metrics = metrics_of(job, estimation, estimate, wall_seconds, ended)
    directory.write_metrics(metrics)
    return metrics


def _feed(job: Job, estimation: Estimation, watcher: Watcher, view: View) -> bool:
    """Feed all frames; True if the user interrupted it."""
    with deferred_interruption() as interruption:
        for frame in job.frames:
            report = estimation.process(frame)
            if report is not None:
                if isinstance(estimation.mapper, GMapping):
                    job.observe(frame, report, estimation.mapper)
                view.show(snapshot(frame, report, estimation.mapper, collided=job.collided()))
                watcher.step(frame.stamp, job.share_done(), estimation.steps.last_error)
            if interruption.requested:
                return True
    return False


def snapshot(frame: Frame, report: StepReport, mapper: GMapping | Localization, *, collided: bool = False) -> Snapshot:
    """What a view is shown of one scan, straight after the filter was given it."""
    samples = None if report.proposed is None else report.proposed.samples[report.best]
    if samples is not None and np.isnan(samples).any():  # none were drawn: matching failed, or another proposal
        samples = None
    return Snapshot(
        stamp=frame.stamp,
        estimate=report.pose,
        odometry=frame.odometry,
        truth=frame.truth,
        scan=frame.scan,
        step=report,
        poses=mapper.poses,
        weights=mapper.weights,
        proposal_samples=samples,
        collided=collided,
        path=mapper.path,
        map=mapper.map,
    )


def _write(job: Job, directory: RunDirectory, estimation: Estimation, filtered: Estimate, estimate: Estimate) -> None:
    """All files but the metrics and the report."""
    directory.write_trajectory("estimate.tum", estimate.at_scans)
    directory.write_trajectory("estimate_dense.tum", estimate.dense)
    if estimate is not filtered:
        directory.write_trajectory("filter.tum", filtered.at_scans)
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
    _write_finding(job, directory, estimation, estimate)


def _write_finding(job: Job, directory: RunDirectory, estimation: Estimation, estimate: Estimate) -> None:
    """Where it went wrong, with the scan that shows it; nothing where there is nothing to judge by."""
    finding = find(
        estimate.at_scans,
        truth=estimation.trajectory_at_scans("truth"),
        relations=job.relations,
        dense=estimate.dense,
        steps=estimation.steps.columns(),
    )
    if finding is None:
        return
    frame = estimation.frames[estimate.scan_frames[finding.scan]]
    assert frame.scan is not None
    rays = make_rays([frame.scan], usable_range=job.filter.map.usable_range, twist=frame.twist)
    write_finding(directory / "finding.json", finding, rays.ends)


def metrics_of(
    job: Job, estimation: Estimation, estimate: Estimate, wall_seconds: float, ended: str | None
) -> dict[str, Any]:
    """All measures of an estimate, JSON-ready: the content of `metrics.json`.

    wall_seconds: time that the estimate took. ended: why the run did not end by itself, see `eval.outcome.judge`.
    """
    metrics = score(
        estimate.at_scans,
        reference=Reference(
            trajectory=estimation.trajectory_at_scans("truth"),
            relations=job.relations,
            grid=job.truth_map,
            lidars=lidar_views(estimation.frames),
        ),
        odometry=estimation.trajectory_at_scans("odometry"),
        dense=estimate.dense,
        # Ctrl-C must end soon, and these measures are dear; a map that was given is nobody's result
        grid=None if ended == "interrupted" or job.known_map is not None else estimate.map,
        steps=estimation.steps.columns(),
        ended=ended,
        facts={
            "seed": job.seed,
            "particles": job.filter.particles,
            "wall_s": wall_seconds,
            "peak_rss_mb": peak_memory_mb(),
            "result_hash": result_hash(estimate.at_scans, estimate.map),
        },
    )
    return metrics if job.known_map is None else metrics | _localized(job.known_map, estimation, estimate, ended)


def _localized(known: KnownMap, estimation: Estimation, estimate: Estimate, ended: str | None) -> dict[str, Any]:
    """What `metrics.json` says of a localisation; the outcome where it is not to be trusted."""
    assert isinstance(estimation.mapper, Localization)
    truth = estimation.trajectory_at_scans("truth")
    found = localization_metrics(known, estimation.mapper.status, estimation.frames, estimate.at_scans, truth)
    astray = why_astray(found)
    if ended is not None or astray is None:
        return {"localization": found}
    return {"outcome": "lost", "outcome_reason": astray, "localization": found}


def drive_ended(simulation: Simulation, duration: float | None) -> str | None:
    """Why a simulated drive did not end as planned; `duration` [s] is what was allowed, None = the whole tour."""
    if simulation.collided:
        return "collided"
    return None if simulation.finished or (duration is not None and not simulation.stuck) else "timeout"


def peak_memory_mb() -> float:
    """Largest resident set of this process so far [MB]."""
    unit = 1 if sys.platform == "darwin" else 1024  # macOS counts bytes, Linux kibibytes
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
