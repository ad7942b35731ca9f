# SPDX-License-Identifier: MIT
"""Runs systems on one recording, each into a run directory of its own, scored as this package's filter is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from eval.estimates import PathAndMap, named, score_estimate
from eval.failure_cause import find_cause
from eval.files.failure_json import write_failure
from eval.first_failure import find_failure
from eval.scoring import Reference, cells_in_sight, score
from eval.trajectory.trajectory import Trajectory
from slam.config import MapConfig
from slam.sensor.rays import make_rays
from testbed.formats.commands import commands_of, write_commands
from testbed.frame import Frame
from testbed.run.execute import lidar_views, true_twist
from testbed.run.run_directory import RunDirectory, result_hash
from testbed.systems.entrant import Entrant
from testbed.systems.feeding import Cost, Estimated, Step


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """What all systems of a comparison see, and what they are scored by."""

    frames: Sequence[Frame]
    """The frames, with the truth, which systems are not shown."""
    seed: int
    """The seed that systems are given."""
    reference: Reference
    """What is known to be right."""
    ended: str | None = None
    """Why the drive did not end as planned (`eval.outcome.judge`); None = it did."""

    @classmethod
    def of(cls, frames: Sequence[Frame], seed: int, reference: Reference, ended: str | None = None) -> Recorded:
        """Add the true path, the lidars, and the cells in their sight, which is the same for all systems."""
        truth = trajectory_at_scans(frames, lambda frame: frame.truth)
        lidars = reference.lidars or lidar_views(frames)
        observable = reference.observable
        if observable is None and truth is not None and reference.grid is not None:
            observable = cells_in_sight(reference.grid, truth, lidars)
        known = replace(reference, trajectory=truth, lidars=lidars, observable=observable)
        return cls(frames=frames, seed=seed, reference=known, ended=ended)

    @property
    def odometry(self) -> Trajectory | None:
        """The wheels' poses at the scans."""
        return trajectory_at_scans(self.frames, lambda frame: frame.odometry)


def execute_system(
    entrant: Entrant, recorded: Recorded, directory: RunDirectory, document: Mapping[str, Any], step: Step | None = None
) -> tuple[dict[str, Any], Estimated]:
    """Run a system, write all files except the report, and return the content of `metrics.json` and the estimate.

    document: content of `config.toml`. After an exception the outcome is `failed`, and the exception is raised again;
    SystemFailedError and SystemsError name the system and what was expected.
    """
    with directory.marked():
        facts = entrant.facts()
        directory.write_config({**document, "system": facts})
        estimated, cost = entrant.run(recorded.frames, recorded.seed, step)
        _write(recorded, estimated, directory)
        metrics = metrics_of_system(facts, recorded, estimated, cost)
        directory.write_metrics(metrics)
        return metrics, estimated


def metrics_of_system(facts: Mapping[str, Any], recorded: Recorded, estimated: Estimated, cost: Cost) -> dict[str, Any]:
    """Return the content of `metrics.json`: the keys that a run has which do not look into the filter.

    The group `system` holds name, version and cost. The pose while driving is scored as `trajectory_online`.
    """
    at_scans, reference, ended = estimated.dense[estimated.at_scans], recorded.reference, recorded.ended
    stamps = np.array([frame.stamp for frame in recorded.frames if frame.scan is not None])
    duration = float(np.ptp(stamps))
    metrics = score(
        at_scans,
        reference=reference,
        odometry=recorded.odometry,
        dense=estimated.dense,
        grid=estimated.grid,
        ended=ended,
        facts={
            "system": {"name": facts["name"], "version": facts["version"], **asdict(cost)},
            "seed": recorded.seed,
            "scans": len(stamps),
            "duration_s": duration,
            "wall_s": cost.wall_s,
            "realtime_factor": duration / cost.wall_s if cost.wall_s > 0.0 else None,
            "result_hash": None if estimated.grid is None else result_hash(at_scans, estimated.grid),
        },
    )
    metrics["notes"] = [*estimated.notes, *metrics["notes"]]
    if estimated.online is not None:
        metrics |= score_estimate("online", PathAndMap(at_scans=estimated.online), reference, ended)
    return metrics | named("filter", metrics)


def trajectory_at_scans(frames: Sequence[Frame], pose: Callable[[Frame], Any]) -> Trajectory | None:
    """Return a pose of the frames with a scan at which it is known; None if it is known at none."""
    known = [(frame.stamp, pose(frame)) for frame in frames if frame.scan is not None and pose(frame) is not None]
    if not known:
        return None
    stamps, poses = zip(*known, strict=True)
    return Trajectory(np.array(stamps), np.array(poses))


def _write(recorded: Recorded, estimated: Estimated, directory: RunDirectory) -> None:
    """Write all files except metrics and report."""
    reference, odometry = recorded.reference, recorded.odometry
    directory.write_trajectory("estimate.tum", estimated.dense[estimated.at_scans])
    directory.write_trajectory("estimate_dense.tum", estimated.dense)
    if estimated.online is not None:
        directory.write_trajectory("online.tum", estimated.online)
    if odometry is not None:
        directory.write_trajectory("odometry.tum", odometry)
    if reference.trajectory is not None:
        directory.write_trajectory("truth.tum", reference.trajectory)
    if commands := commands_of(recorded.frames):
        write_commands(directory / "commands.csv", commands)
    if estimated.grid is not None:
        directory.write_map("map", estimated.grid)
    if reference.grid is not None:
        directory.write_map("truth_map", reference.grid)
    _write_failure(recorded, estimated, directory)


def _write_failure(recorded: Recorded, estimated: Estimated, directory: RunDirectory) -> None:
    """Write where it went wrong, with the scan that shows it; nothing where there is nothing to judge by."""
    truth, at_scans = recorded.reference.trajectory, estimated.dense[estimated.at_scans]
    failure = find_failure(at_scans, truth=truth, relations=recorded.reference.relations, dense=estimated.dense)
    if failure is None:
        return
    if failure.bad:
        cause = find_cause(failure.stamp, odometry=recorded.odometry, reference=truth, estimate=at_scans)
        failure = replace(failure, cause=cause)
    row = int(estimated.frames[estimated.at_scans[failure.shown_scan]])
    frame, twist = recorded.frames[row], true_twist(recorded.frames, row)
    assert frame.scan is not None
    usable = MapConfig().usable_range
    rays = make_rays([frame.scan], usable_range=usable, twist=frame.twist if twist is None else twist)
    write_failure(directory / "finding.json", failure, rays.ends)
