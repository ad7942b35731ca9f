# SPDX-License-Identifier: MIT
"""The run directory, see docs/run-directory.md."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from eval.files.atomic_write import atomic_write
from eval.files.map_server import write_map
from eval.files.tum import write_tum
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from testbed.toml import dump_toml

RUN_FILES = (
    "config.toml",
    "estimate.tum",
    "odometry.tum",
    "truth.tum",
    "estimate_dense.tum",
    "filter.tum",
    "online.tum",
    "estimate_covariance.parquet",
    "graph.g2o",
    "commands.csv",
    "map.pgm",
    "map.yaml",
    "truth_map.pgm",
    "truth_map.yaml",
    "metrics.json",
    "steps.parquet",
    "finding.json",
    "program.log",
    "recording.rrd",
    "report.html",
)
"""Every file that a run may contain; `--overwrite` removes these and no others."""


class RunDirectoryError(ValueError):
    """A directory cannot hold a run; the message names it and says what to do."""


@dataclass(frozen=True)
class RunDirectory:
    """The directory of one run, which is complete when `metrics.json` exists: that is written last."""

    path: Path

    @classmethod
    def create(cls, path: str | Path, *, overwrite: bool = False) -> RunDirectory:
        """Create the directory, or remove the files of an older run from it.

        Raises RunDirectoryError, and changes nothing, if `path` is a file, or is not empty and `overwrite` is not set.
        With `overwrite` the files of the older run are removed, metrics first, so that a crash leaves no run that looks
        complete; files that no run writes are kept.
        """
        path = Path(path)
        cls.check(path, overwrite=overwrite)
        for name in ("metrics.json", *RUN_FILES):
            (path / name).unlink(missing_ok=True)
        path.mkdir(parents=True, exist_ok=True)
        return cls(path)

    @staticmethod
    def check(path: Path, *, overwrite: bool = False) -> None:
        """Raise RunDirectoryError where `create` would; nothing is changed."""
        if path.exists() and not path.is_dir():
            raise RunDirectoryError(f"{path}: is a file, expected a directory")
        if path.is_dir() and any(path.iterdir()) and not overwrite:
            raise RunDirectoryError(f"{path}: is not empty; choose another --out or add --overwrite")

    def __truediv__(self, name: str) -> Path:
        """Return the path of one of the files in `RUN_FILES`."""
        if name not in RUN_FILES:
            raise RunDirectoryError(f"{name} is no file of a run: expected one of {', '.join(RUN_FILES)}")
        return self.path / name

    def write_config(self, document: Mapping[str, Any]) -> None:
        """Write `config.toml`."""
        with atomic_write(self / "config.toml") as aside:
            aside.write_text(dump_toml(document), encoding="utf-8")

    def write_trajectory(self, name: str, trajectory: Trajectory) -> None:
        """Write one of the `.tum` files."""
        write_tum(self / name, trajectory)

    def write_map(self, name: str, grid: OccupancyGrid) -> None:
        """Write `map` or `truth_map`, both files."""
        write_map(self / f"{name}.yaml", grid)

    def write_metrics(self, metrics: Mapping[str, Any]) -> None:
        """Write `metrics.json`, which completes the run; `metrics` are JSON-ready, as `eval.scoring` returns them."""
        with atomic_write(self / "metrics.json") as aside:
            aside.write_text(json.dumps(metrics, indent=2, allow_nan=False) + "\n", encoding="utf-8")

    @contextmanager
    def marked(self, known: Mapping[str, Any] | None = None, *, stage: str = "") -> Iterator[None]:
        """Write the outcome to `metrics.json`, with the measures in `known`, if an exception ends the block.

        The outcome is `interrupted` (Ctrl-C) or `failed`, with the reason. The exception is raised again.
        stage: what is done in the block, such as "the kernels were compiled"; it completes the reason of an exception
        that has no message, as Ctrl-C has none
        """
        try:
            yield
        except BaseException as error:
            by_hand = isinstance(error, KeyboardInterrupt)
            what = "the run was stopped by hand" if by_hand else f"the run ended with {type(error).__name__}"
            reason = " ".join(f"{error}".split()) or what + (f" while {stage}" if stage else "")
            mark = {"outcome": "interrupted" if by_hand else "failed", "reason": reason}
            try:
                self.write_metrics({**(known or {}), **mark})
            except OSError:  # the disk is full: without metrics.json no run looks finished
                with suppress(OSError):
                    (self / "metrics.json").unlink(missing_ok=True)
            raise


def default_directory(name: str, now: datetime) -> Path:
    """Return a new directory below `runs/` of the working directory: name and local time, numbered if it exists."""
    base = Path("runs") / f"{name}-{now:%Y%m%d-%H%M%S}"
    path, number = base, 2
    while path.exists():
        path, number = base.with_name(f"{base.name}-{number}"), number + 1
    return path


def result_hash(trajectory: Trajectory, grid: OccupancyGrid) -> str:
    """Return the SHA-256 of the bits of a trajectory (stamps and poses) and a map; equal results have equal hashes."""
    digest = hashlib.sha256()
    for array in (
        np.asarray(trajectory.stamps, dtype="<f8"),
        np.asarray(trajectory.poses, dtype="<f8"),
        np.asarray(grid.probability.shape, dtype="<i8"),
        # every NaN alike, whatever its payload
        np.where(np.isnan(grid.probability), np.float32("nan"), grid.probability).astype("<f4"),
        np.array([grid.resolution, *grid.origin], dtype="<f8"),
    ):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
