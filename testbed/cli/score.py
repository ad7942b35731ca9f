# SPDX-License-Identifier: MIT
"""`testbed score`."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from eval.failure_cause import find_cause
from eval.files.atomic_write import atomic_write
from eval.files.failure_json import write_failure
from eval.files.map_server import read_map, write_map
from eval.files.tum import read_tum, write_tum
from eval.first_failure import find_failure
from eval.limits import Limit, check
from eval.map.lidar_view import LidarView
from eval.report.run_report import write_report
from eval.scoring import read_estimate, score_files
from eval.trajectory.relations import read_relations
from eval.trajectory.trajectory import Trajectory
from slam.config import MapConfig
from slam.sensor.rays import make_rays
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import console, results
from testbed.cli.shared.status import GATE_FAILED
from testbed.cli.shared.summary import headline_table
from testbed.datasets.simulated import ONE_FILE
from testbed.formats import open_log
from testbed.formats.parquet import TABLE
from testbed.run.execute import lidar_views, true_twist

NEAR_SCAN_S = 1.0
"""A scan belongs to a moment if it was taken within this time of it [s]."""


def score(
    dataset: Path,
    *,
    trajectory: Path,
    map_: Annotated[Path | None, Parameter(name="--map")] = None,
    relations: Path | None = None,
    time_offset: str = "0",
    out: Path | None = None,
    fail_if: tuple[str, ...] = (),
) -> int:
    """Score the trajectory and the map of any SLAM system with the same measures as `testbed run`.

    The measures are printed as JSON, or written to --out.

    Parameters
    ----------
    dataset
        Directory of a dataset or a run, with truth.tum and, to score a map, truth_map.yaml. Cells that its lidars could
        not see are not scored.
    trajectory
        The system's trajectory: TUM (`t x y z qx qy qz qw`), EuRoC, or KITTI poses with stamps.
    map_
        The system's map in the ROS map_server format (.yaml and a picture).
    relations
        Hand-checked relations between poses, `t1 t2 x y z roll pitch yaw`.
    time_offset
        Seconds to add to the trajectory's stamps, or "auto": the constant offset, if any, that explains the error.
        (`testbed slam --time-offset` is subtracted from the stamps of scans.)
    out
        Directory for metrics.json, finding.json (where it went wrong; its `stamp` is the moment), report.html, and
        copies of the trajectories and maps that the report shows. It may hold results of an earlier call, but no run.
    fail_if
        Exit with status 1 if this holds, e.g. 'map.iou < 0.5'; may be repeated.
    """
    limits = [Limit.parse(text) for text in fail_if]
    if out is not None and (out / "config.toml").exists():
        raise ValueError(f"{out}: holds a run, whose files would be replaced; choose another --out")
    offset = _time_offset(time_offset)
    AT_WORK.now_doing(f"scoring {trajectory}")
    metrics = score_files(
        dataset,
        trajectory,
        map_,
        relations=relations,
        lidars=_lidars(dataset) if map_ else (),
        time_offset=offset,
    )
    text = json.dumps(metrics, indent=2, allow_nan=False) + "\n"
    if out is None:
        sys.stdout.write(text)
    else:
        out.mkdir(parents=True, exist_ok=True)
        truth = read_tum(dataset / "truth.tum") if _has(dataset, "truth") else None
        estimate, _ = read_estimate(trajectory, truth, offset)
        _write_scored(out, dataset, estimate, map_, relations)
        with atomic_write(out / "metrics.json") as aside:
            aside.write_text(text, encoding="utf-8")
        results.print(f"report: {write_report(out).resolve()}")
    console.print(headline_table(metrics, out))
    for note in metrics["notes"]:
        console.print(f"note: {note}", soft_wrap=True)
    broken = check(metrics, limits)
    for sentence in broken:
        console.print(f"limit broken: {sentence}", soft_wrap=True)
    return GATE_FAILED if broken else 0


def _write_scored(out: Path, dataset: Path, estimate: Trajectory, map_: Path | None, relations: Path | None) -> None:
    """Write what the report shows in addition to the metrics: trajectories, maps, and where it went wrong."""
    known = {name: read_tum(dataset / f"{name}.tum") for name in ("truth", "odometry") if _has(dataset, name)}
    for name, path in (("map", map_), ("truth_map", dataset / "truth_map.yaml")):
        if map_ is not None and path is not None and path.is_file():
            write_map(out / f"{name}.yaml", read_map(path))
    for name, written in {"estimate": estimate, **known}.items():
        write_tum(out / f"{name}.tum", written)
    failure = find_failure(
        estimate, truth=known.get("truth"), relations=None if relations is None else read_relations(relations)
    )
    if failure is None:
        (out / "finding.json").unlink(missing_ok=True)
        return
    if failure.bad:
        cause = find_cause(
            failure.stamp, odometry=known.get("odometry"), reference=known.get("truth"), estimate=estimate
        )
        failure = replace(failure, cause=cause)
    write_failure(out / "finding.json", failure, _scan_points(dataset, float(estimate.stamps[failure.shown_scan])))


def _has(dataset: Path, name: str) -> bool:
    return (dataset / f"{name}.tum").is_file()


def _time_offset(text: str) -> float | Literal["auto"]:
    if text == "auto":
        return "auto"
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise ValueError(f"--time-offset {text!r}: expected seconds, such as -0.3, or auto")
    return seconds


def _lidars(dataset: Path) -> tuple[LidarView, ...]:
    """Return the lidars of a dataset's recording; none if the directory holds no recording."""
    recording = _recording(dataset)
    return () if recording is None else lidar_views(open_log(recording).frames)


def _recording(dataset: Path) -> Path | None:
    """Return the recording of a dataset; None if the directory holds none, or several."""
    if any((dataset / name).is_file() for name in ("metadata.yaml", TABLE)):
        return dataset
    recordings = sorted(path for suffix in ONE_FILE.values() for path in dataset.glob(f"*{suffix}"))
    return recordings[0] if len(recordings) == 1 else None


def _scan_points(dataset: Path, stamp: float) -> NDArray[np.float64]:
    """Return the end points (k, 2) of the scan nearest to a time [s] in the robot's frame [m]; none without one."""
    recording = _recording(dataset)
    frames = [] if recording is None else open_log(recording).frames
    near = [frame for frame in frames if abs(frame.stamp - stamp) < NEAR_SCAN_S]
    rows = [row for row, frame in enumerate(near) if frame.scan is not None]
    if not rows:
        return np.zeros((0, 2))
    row = min(rows, key=lambda row: abs(near[row].stamp - stamp))
    frame, twist = near[row], true_twist(near, row)
    assert frame.scan is not None
    usable = MapConfig().usable_range
    return make_rays([frame.scan], usable_range=usable, twist=frame.twist if twist is None else twist).ends
