# SPDX-License-Identifier: MIT
"""What a system made of a drive, and how it scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eval.report import plots
from eval.report.comparison import MEASURES
from eval.report.map_images import draw_map, frame_around
from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.cli.shared.console import ProgressLine, progress_line
from testbed.frame import Frame
from testbed.library import html
from testbed.library.drive import Drive
from testbed.systems.entrant import ClassSystem, Entrant, PythonSystem, entrant_of, facts_of
from testbed.systems.execute import metrics_of_system
from testbed.systems.feeding import Cost, Estimated, Step, estimated_from, feed
from testbed.systems.program import DatasetFormat
from testbed.systems.protocol import System, SystemClass


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result:
    """Trajectory, map and measures of a system on a drive."""

    system: str
    drive: Drive
    estimated: Estimated
    metrics: html.Table
    """The content of `metrics.json`, see docs/metrics.md: a `dict`."""

    @property
    def trajectory(self) -> Trajectory:
        """Poses `T_map_robot` at the scans."""
        return self.estimated.dense[self.estimated.at_scans]

    @property
    def map(self) -> OccupancyGrid | None:
        """The map; None where the system has none."""
        return self.estimated.grid

    def metric(self, key: str) -> Any:
        """A measure by its dotted key, such as `trajectory.ate_rmse_m`; None where there is none."""
        value: Any = self.metrics
        for part in key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        return value

    def __repr__(self) -> str:
        """One line: outcome and main figures."""
        shown = (
            ("trajectory.ate_rmse_m", "error {:.3f} m"),
            ("relations.trans_mean_m", "relations {:.3f} m"),
            ("map.f1_1_cells", "map F1 {:.3f}"),
            ("system.ms_per_scan", "{:.1f} ms a scan"),
        )
        words = [text.format(self.metric(key)) for key, text in shown if self.metric(key) is not None]
        return f"<Result {self.system} on {self.drive.name}: {', '.join([self.metrics['outcome'], *words])}>"

    def _repr_html_(self) -> str:
        rows = [
            (measure.label, measure.number_format.format(measure.factor * value))
            for measure in MEASURES
            if (value := self.metric(measure.key)) is not None
        ]
        T, truth = self.T_frame_map, self.drive.recorded.reference.trajectory
        curves: list[plots.Series] = [] if truth is None else [("truth", truth.poses[:, :2], plots.TRUTH)]
        curves.append((self.system, se2.compose(T, self.trajectory.poses)[:, :2], plots.ESTIMATE))
        background = None
        if self.map is not None and self.map.known.any():
            background = draw_map(self.map, frame_around(self.map, T, [], 0.5), T)
        shown = html.picture(plots.paths(curves, background=background))
        return f"{html.line(repr(self))}{shown}{html.table(('measure', self.system), rows)}"

    @property
    def T_frame_map(self) -> Pose:
        """The map's frame seen from the truth's, (3,); zero where the truth is unknown."""
        T = self.metric("trajectory.T_truth_estimate")
        return np.zeros(3) if T is None else np.asarray(T, dtype=np.float64)


def run(
    system: str | System | SystemClass,
    drive: Drive,
    *,
    seed: int = 0,
    settings: Mapping[str, object] | None = None,
    format: DatasetFormat = "rosbag2",
) -> Result:
    """Run a system on a drive and score it.

    system: a name (`systems()`), FILE.py:CLASS, a command with {dataset} and {out}, a class, or a fresh instance
    settings: values by dotted name, but for a command and an instance, which has its own
    format: of the recording that a command reads, as `--system-format` has it

    Raises SystemsError where it cannot be made, SystemFailedError where it has no result.
    """
    recorded = replace(drive.recorded, seed=seed)
    with progress_line() as line:
        step = _step_of(line, recorded.frames)
        if isinstance(system, str | type):
            entrant = _entrant(system, settings or {}, format)
            facts, name = entrant.facts(), entrant.name
            line.stage(name)
            estimated, cost = entrant.run(recorded.frames, seed, step)
        else:
            facts, name = facts_of(system), type(system).__name__
            line.stage(name)
            estimated, cost = feed(system, name, recorded.frames, seed, step)
    metrics = metrics_of_system(facts, recorded, estimated, cost)
    return Result(system=name, drive=drive, estimated=estimated, metrics=html.Table(metrics))


def _step_of(line: ProgressLine, frames: Sequence[Frame]) -> Step:
    """Return what says after each scan how far a run is, and that the last scan was taken."""
    rows = {id(frame): row for row, frame in enumerate(frames) if frame.scan is not None}
    last = max(rows.values(), default=0)

    def step(frame: Frame) -> None:
        line.step(frame.stamp, (rows[id(frame)] + 1) / len(frames), None)
        if rows[id(frame)] == last:
            line.stage("after the last scan")

    return step


def _entrant(system: str | SystemClass, settings: Mapping[str, object], kind: DatasetFormat) -> Entrant:
    if not isinstance(system, str):
        return ClassSystem(system, settings)
    entrant = entrant_of(system, kind)
    return replace(entrant, settings=settings) if isinstance(entrant, PythonSystem) else entrant


def evaluate(
    trajectory: Trajectory, drive: Drive, *, map: OccupancyGrid | None = None, name: str = "estimate"
) -> Result:
    """Score a trajectory that is there already, and maybe its map, both in one frame.

    Raises SystemFailedError where its stamps are not those of the drive.
    """
    estimated = estimated_from(name, drive.recorded.frames, trajectory, map)
    facts = {"name": name, "version": "", "settings": {}}
    metrics = metrics_of_system(facts, drive.recorded, estimated, Cost(wall_s=0.0))
    return Result(system=name, drive=drive, estimated=estimated, metrics=html.Table(metrics))
