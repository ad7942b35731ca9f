# SPDX-License-Identifier: MIT
"""Read a run directory (docs/run-directory.md) for the report; missing files give None."""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.consistency import stacked
from eval.files.failure_json import ShownFailure, read_failure
from eval.files.map_server import read_map
from eval.files.tum import read_tum
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid


class RunFilesError(ValueError):
    """A directory that is no run, or whose files cannot be read; the message names the file."""


@dataclass(frozen=True, eq=False)
class RunFiles:
    """One run, read from its directory."""

    path: Path
    metrics: dict[str, Any]
    config: dict[str, Any]
    estimate: Trajectory | None
    odometry: Trajectory | None
    truth: Trajectory | None
    grid: OccupancyGrid | None
    truth_grid: OccupancyGrid | None
    steps: dict[str, NDArray[Any]] | None
    """Columns of `steps.parquet`; nulls of numbers are NaN."""
    failure: ShownFailure | None
    """Where it went wrong."""
    covariances: NDArray[np.float64] | None = None
    """Covariances of the poses of the estimate relative to the first, (scans, 3, 3)."""

    @property
    def name(self) -> str:
        """Name of the directory."""
        return self.path.resolve().name

    def metric(self, key: str) -> Any:
        """Return a measure by its key with dots, such as `map.iou`; None where it is missing."""
        value: Any = self.metrics
        for part in key.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        return value


def read_run(path: str | os.PathLike[str]) -> RunFiles:
    """Read a run directory; raises RunFilesError where it has no `metrics.json`, ValueError for damaged files."""
    folder = Path(path)
    if not (folder / "metrics.json").is_file():
        raise RunFilesError(f"{folder}: expected a run directory with metrics.json in it")
    return RunFiles(
        path=folder,
        metrics=_read_json(folder / "metrics.json"),
        config=_read_toml(folder / "config.toml"),
        estimate=_trajectory(folder / "estimate.tum"),
        odometry=_trajectory(folder / "odometry.tum"),
        truth=_trajectory(folder / "truth.tum"),
        grid=_map(folder / "map.yaml"),
        truth_grid=_map(folder / "truth_map.yaml"),
        steps=read_steps(folder / "steps.parquet"),
        failure=read_failure(folder / "finding.json") if (folder / "finding.json").is_file() else None,
        covariances=_covariances(folder / "estimate_covariance.parquet"),
    )


def _read_json(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise RunFilesError(f"{path}: expected JSON: {error}") from None
    if not isinstance(document, dict):
        raise RunFilesError(f"{path}: expected a JSON object")
    return document


def _read_toml(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise RunFilesError(f"{path}: expected TOML: {error}") from None


def _trajectory(path: Path) -> Trajectory | None:
    return read_tum(path) if path.is_file() else None


def _covariances(path: Path) -> NDArray[np.float64] | None:
    columns = read_steps(path)
    try:
        return None if columns is None else stacked(columns.__getitem__)
    except KeyError as error:
        raise RunFilesError(f"{path}: expected a column {error}") from None


def _map(path: Path) -> OccupancyGrid | None:
    return read_map(path) if path.is_file() else None


def read_steps(path: Path) -> dict[str, NDArray[Any]] | None:
    """Read the columns of `steps.parquet`, or of another table; nulls of numbers are NaN. None where there is no file.

    Raises RunFilesError for a damaged file.
    """
    if not path.is_file():
        return None
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with path.open("rb") as file:
            table = pq.read_table(file)
    except pa.ArrowInvalid as error:
        raise RunFilesError(f"{path}: expected a parquet table: {error}") from None
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    return {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
