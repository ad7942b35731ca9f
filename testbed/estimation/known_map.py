# SPDX-License-Identifier: MIT
"""The part of a run that only localisation has: the known map and the measures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eval.files.map_server import grid_from_map_file
from eval.outcome import LOCAL_M
from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from eval.trajectory.trajectory import Trajectory
from slam.config import LocalizationConfig
from slam.localization import LocalizationStatus
from slam.localization.fixed_map import check_map, checked_start
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.frame import Frame
from worlds.format.map_file import read_map_file


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownMap:
    """The map to localise in, the start and the settings."""

    grid: OccupancyGrid
    """The map."""
    start: Pose | None
    """Approximate start `T_map_robot` (3,); None = unknown."""
    settings: LocalizationConfig
    """Settings of the localisation."""
    has_frame_of_truth: bool = False
    """Whether true poses are in the frame of this map, so that errors need no alignment."""
    notes: tuple[str, ...] = ()
    """What a reader of the map must know (`worlds.format.map_file`)."""

    @classmethod
    def read(cls, path: Path, start: str | None, settings: LocalizationConfig, truth: OccupancyGrid | None) -> KnownMap:
        """Read a map_server map and a start "X,Y,DEG" in its frame [m, m, deg].

        truth: the true map; if it equals the map, true poses are in the map's frame. Raises ValueError if the map
        cannot be read, has no walls or no free space, or the start is not on it.
        """
        file = read_map_file(path)
        grid = grid_from_map_file(file)
        try:
            check_map(grid)
            pose = None if start is None else checked_start(parse_start(start), grid, 2.0 * settings.start_position)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        shared = truth is not None and _equal(grid, truth)
        return cls(grid=grid, start=pose, settings=settings, has_frame_of_truth=shared, notes=file.notes)


def parse_start(text: str) -> tuple[float, float, float]:
    """Return the pose (x, y, theta) [m, m, rad] of "X,Y,DEG". Raises ValueError for other text."""
    try:
        x, y, degrees = map(float, text.split(","))
    except ValueError:
        raise ValueError(f"start {text!r}: expected X,Y,DEG, three numbers, such as 1.5,-2,90") from None
    return x, y, math.radians(degrees)


def _equal(a: OccupancyGrid, b: OccupancyGrid) -> bool:
    return (
        np.allclose([a.resolution, *a.origin], [b.resolution, *b.origin], atol=1e-9)
        and a.probability.shape == b.probability.shape
        and np.array_equal(a.occupied, b.occupied)
    )


def localization_metrics(
    known: KnownMap, found: LocalizationStatus, frames: Sequence[Frame], estimate: Trajectory, truth: Trajectory | None
) -> dict[str, Any]:
    """Return the group `localization` of `metrics.json`.

    estimate: one pose per scan of `frames`; truth: the true path, None = unknown
    """
    scans = [frame for frame in frames if frame.scan is not None]
    odometry = np.array([frame.odometry for frame in scans])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(odometry[:, :2], axis=0).T))])
    first = found.found_at[0] if found.found_at else None
    metrics: dict[str, Any] = {
        "start": "given" if known.start is not None else "unknown",
        "state": found.state,
        "places": found.clusters,
        "fit": found.explained_share,
        "found_after_m": None if first is None else float(way[first]),
        "found_after_s": None if first is None else scans[first].stamp - scans[0].stamp,
        "losses": len(found.lost_at),
        "lost_at_s": [scans[number].stamp - scans[0].stamp for number in found.lost_at],
    }
    if truth is not None and known.has_frame_of_truth:
        error = absolute_error(associate(estimate, truth), "none")
        metrics |= {
            "error_rmse_m": error.translation.rmse,
            "error_median_m": error.translation.median,
            "error_p95_m": error.translation.p95,
            "error_max_m": error.translation.max,
            "heading_error_mean_deg": error.rotation.mean,
            "heading_error_max_deg": error.rotation.max,
        }
    return metrics


def failure_reason(metrics: dict[str, Any]) -> str | None:
    """Return why a localisation with these `localization_metrics` failed; None if it did not."""
    if metrics["losses"]:
        return _why_lost(metrics)
    if metrics["state"] == "searching":
        return "the robot was not found: after all scans its position in the map is still unknown"
    if metrics["state"] == "ambiguous":
        if metrics["places"] > 1:
            return f"ambiguous: {metrics['places']} positions in the map explain the scans equally well"
        return "the robot was not found: too few scans were processed to be sure of its position"
    error = metrics.get("error_median_m")
    if error is not None and error > LOCAL_M:
        return f"the robot was localised in a wrong position: the median error is {error:.2f} m"
    return None


def _why_lost(metrics: dict[str, Any]) -> str:
    times = f"{metrics['losses']} times" if metrics["losses"] > 1 else "once"
    if metrics["found_after_m"] is None:
        return (
            f"the robot was not found: no position in the map explains the scans (tried {times}); "
            "the map may be of another place"
        )
    return (
        f"the scans stopped fitting the map {times}, first after {metrics['lost_at_s'][0]:.1f} s: the robot was moved, "
        "or the map is not of this place"
    )
