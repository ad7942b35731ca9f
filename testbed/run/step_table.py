# SPDX-License-Identifier: MIT
"""The table of a run, one row per scan, with the columns of docs/run-directory.md."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from slam import se2
from slam.diagnosis.contradiction import Verdict
from slam.se2 import Pose
from slam.sensor.rays import BeamCounts
from slam.step.step_report import StepReport
from testbed.frame import Frame
from testbed.views.another_best import moved_by_another_best

FLAGS = ("updated", "resampled", "loop_closed", "odometry_jumped")
COUNTS = ("scan", "particles", "match_failures", "particles_died", "unique_ancestors", "map_bytes", *BeamCounts._fields)
VERDICTS = get_args(Verdict)
"""The column `self_check` holds the number of the verdict: 0 plausible, 1 doubtful, 2 lost."""
BATCH = 512
"""Rows that are kept as they come; whole batches become columns, which take a tenth of their memory: an hour at
40 Hz would take half a gigabyte."""
TRUTH_COLUMNS = ("true_x", "true_y", "true_theta", "error_m", "error_deg")


@dataclass
class StepTable:
    """Rows in the order of the scans.

    Errors are those of the online pose. If truth is in another frame than the map, both paths are aligned at the first
    pose.
    """

    aligned: bool = True
    """Whether truth is in its own frame and must be aligned; otherwise it is in the map's frame."""
    _rows: list[dict[str, Any]] = field(default_factory=list)
    _packed: list[dict[str, NDArray[Any]]] = field(default_factory=list)
    """Columns of the batches before `_rows`."""
    _first: tuple[Pose, Pose] | None = None
    _last_error: float = math.nan
    _best: int | None = None  # number of the best particle after the last scan

    def add(
        self,
        frame: Frame,
        report: StepReport,
        filter_seconds: float,
        poses: Pose,
        weights: NDArray[np.float64],
        best: int | None = None,
    ) -> None:
        """Append the row of one scan.

        filter_seconds: time spent in the filter [s];  poses (particles, 3), weights (particles,), best (the number of
        the best particle; None = particles have no lasting numbers): after the scan
        """
        cov = report.covariance
        row: dict[str, Any] = {
            "scan": BATCH * len(self._packed) + len(self._rows),
            "stamp": frame.stamp,
            "updated": report.updated,
            "x": report.pose[0],
            "y": report.pose[1],
            "theta": report.pose[2],
            "cov_xx": cov[0, 0],
            "cov_xy": cov[0, 1],
            "cov_yy": cov[1, 1],
            "cov_xt": cov[0, 2],
            "cov_yt": cov[1, 2],
            "cov_tt": cov[2, 2],
            "particles": report.particles,
            "ess": report.ess,
            "resampled": report.resampled,
            "matched_share": report.matched_share if report.updated else math.nan,
            "match_failures": report.match_failures,
            "log_evidence": report.log_evidence,
            "particles_died": report.particles - len(np.unique(poses, axis=0)) if report.resampled else 0,
            "spread_m": spread_of(poses, weights) if report.updated else math.nan,
            "best_moved_m": moved_by_another_best(self._best, report),
            "unique_ancestors": report.unique_ancestors,
            **report.readings._asdict(),
            "map_bytes": report.map_bytes,
            "loop_closed": report.loop_closed,
            "loop_length": report.loop_length,
            "odometry_jumped": report.odometry_jumped,
            "contradicted_share": _contradicted_share(report),
            "self_check": math.nan if report.self_check is None else VERDICTS.index(report.self_check.verdict),
            "filter_s": filter_seconds,
            **{f"{stage}_s": report.seconds.get(stage, 0.0) for stage in ("match", "sample", "map", "resample")},
        }
        self._best = best
        row |= self._truth(frame, report.pose)
        self._rows.append(row)
        self._last_error = row["error_m"]
        if len(self._rows) == BATCH:
            self._packed.append(_columns_of(self._rows))
            self._rows = []

    def _truth(self, frame: Frame, pose: Pose) -> dict[str, float]:
        if frame.truth is None:
            return dict.fromkeys(TRUTH_COLUMNS, math.nan)
        expected = pose
        if self.aligned:
            if self._first is None:
                self._first = (pose, frame.truth)
            # T_world_estimate: both paths start at the same pose
            first_pose, first_truth = self._first
            expected = se2.compose(first_truth, se2.between(first_pose, pose))
        miss = se2.between(frame.truth, expected)
        values = (*frame.truth, np.hypot(miss[0], miss[1]), np.degrees(abs(miss[2])))
        return dict(zip(TRUTH_COLUMNS, map(float, values), strict=True))

    @property
    def last_error(self) -> float | None:
        """Position error of the last row [m]; None if truth is unknown."""
        return None if math.isnan(self._last_error) else self._last_error

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the table as arrays (scans,); unknown values are NaN."""
        parts = [*self._packed, _columns_of(self._rows)] if self._rows else self._packed
        names = parts[0] if parts else ()
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

    def write(self, path: Path) -> None:
        """Write the table as parquet under a temporary name and rename it; unknown truth is null."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        kinds = {**dict.fromkeys(FLAGS, pa.bool_()), **dict.fromkeys(COUNTS, pa.int64())}
        columns = {
            name: pa.array(values, type=kinds.get(name, pa.float64()), from_pandas=True)  # from_pandas: NaN is null
            for name, values in self.columns().items()
        }
        with atomic_write(path) as aside, aside.open("wb") as file:
            pq.write_table(pa.table(columns), file)


def _columns_of(rows: list[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def spread_of(poses: Pose, weights: NDArray[np.float64]) -> float:
    """Standard deviation of the position over particles with poses (n, 3) and weights (n,), whose sum is 1 [m]; NaN
    where there are none."""
    if not len(poses):
        return math.nan
    positions = poses[:, :2]
    off = positions - weights @ positions
    return math.sqrt(float(weights @ (off * off).sum(axis=1)))


def _contradicted_share(report: StepReport) -> float:
    """Share of the beams, of those of which the map says something, that contradict it; NaN where there is none."""
    beams = report.beams
    return math.nan if beams is None or beams.judged == 0 else beams.contradicting / beams.judged
