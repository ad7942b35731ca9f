# SPDX-License-Identifier: MIT
"""A run directory as a real run leaves it, made in a second: a robot goes twice around a block of rooms."""

from __future__ import annotations

import itertools
import json
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import tomli_w

from eval.files.failure_json import write_failure
from eval.files.map_server import write_map
from eval.files.tum import write_tum
from eval.first_failure import find_failure
from eval.map.grids import cell_centres
from eval.map.lidar_view import LidarView
from eval.map.observability import observable_cells
from eval.scoring import Reference, score
from eval.trajectory.relations import Relations
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, between, compose, inverse, transform_points
from tests.eval.helpers import chain, room, with_wall

PARTICLES = 30
BREAK = 520
"""Scan at which a broken run turns by 12 degrees."""


def ring() -> OccupancyGrid:
    """A true map: a ring corridor of 2 m around a block of 8 m x 4 m, 12 m x 8 m in all, with some cupboards."""
    grid = room(width=12.0, height=8.0)
    grid = with_wall(grid, slice(60, 140), slice(60, 220), 1.0)
    grid = with_wall(grid, slice(61, 139), slice(61, 219), np.nan)
    for row, col, height, width in ((20, 90, 6, 14), (172, 150, 8, 10), (100, 20, 16, 7), (30, 250, 10, 10)):
        grid = with_wall(grid, slice(row, row + height), slice(col, col + width), 1.0)
        grid = with_wall(grid, slice(row + 1, row + height - 1), slice(col + 1, col + width - 1), np.nan)
    return grid


def drive(laps: int = 2, step: float = 0.06) -> Pose:
    """True poses (n, 3) in the ring, `step` metres apart."""
    corners = np.array([[1.0, 1.0], [11.0, 1.0], [11.0, 7.0], [1.0, 7.0]])
    points = np.concatenate([np.tile(corners, (laps, 1)), corners[:1]])
    pieces = []
    for a, b in itertools.pairwise(points):
        n = int(np.linalg.norm(b - a) / step)
        heading = np.arctan2(b[1] - a[1], b[0] - a[0])
        pieces.append(np.column_stack([a + (b - a) * np.arange(n)[:, None] / n, np.full(n, heading)]))
    return np.concatenate(pieces)


def write_run(
    folder: Path, *, truth: bool = True, relations: bool = False, broken: bool = False, seed: int = 0
) -> Path:
    """Write all files of a run but the report.

    truth: path and map are known. relations: scored against relations, as a recorded log. broken: the estimate turns
    wrongly at scan `BREAK`.
    """
    folder.mkdir(parents=True)
    for name, content in _files(truth, relations, broken, seed).items():
        (folder / name).write_bytes(content)
    return folder


@cache
def _files(truth: bool, relations: bool, broken: bool, seed: int) -> dict[str, bytes]:
    """The files of such a run, which many tests change one by one: to score it takes most of the time."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        _compute(folder, truth, relations, broken, seed)
        return {file.name: file.read_bytes() for file in folder.iterdir()}


def _compute(folder: Path, truth: bool, relations: bool, broken: bool, seed: int) -> None:
    """Compute such a run and write its files; see `write_run`."""
    rng = np.random.default_rng(seed)
    poses = drive()
    n = len(poses)
    stamps = 1000.0 + 0.1 * np.arange(n)
    motions = between(poses[:-1], poses[1:])
    odometry = chain(np.concatenate([[np.zeros(3)], motions + rng.normal(0.0, [0.003, 0.0005, 0.004], (n - 1, 3))]))
    slow = np.cumsum(rng.normal(0.0, [0.002, 0.002, 0.0006], (n, 3)), axis=0)
    slow -= np.linspace(0.0, 1.0, n)[:, None] * slow[-1]  # the loop closes
    estimate = between(poses[0], poses + slow)
    if broken:
        estimate[BREAK:] = compose(
            compose(estimate[BREAK], [0.0, 0.0, np.radians(12.0)]), between(estimate[BREAK], estimate[BREAK:])
        )
    true_map = ring()
    grid = _estimated_map(true_map, poses[0], broken, rng)
    true = Trajectory(stamps, poses) if truth else None
    steps = steps_of(stamps, estimate, poses if truth else None, rng)

    trajectories = {"estimate": Trajectory(stamps, estimate), "odometry": Trajectory(stamps, odometry), "truth": true}
    for name, trajectory in trajectories.items():
        if trajectory is not None:
            write_tum(folder / f"{name}.tum", trajectory)
    write_tum(folder / "estimate_dense.tum", trajectories["estimate"])
    write_map(folder / "map.yaml", grid)
    if truth:
        write_map(folder / "truth_map.yaml", true_map)
    pq.write_table(pa.table({k: pa.array(v, from_pandas=True) for k, v in steps.items()}), folder / "steps.parquet")
    (folder / "config.toml").write_bytes(tomli_w.dumps(_config(seed)).encode())
    known = _relations(stamps, poses) if relations else None
    metrics = score(
        trajectories["estimate"],
        reference=Reference(
            trajectory=true,
            grid=true_map if truth else None,
            lidars=(LidarView(),),
            relations=known,
        ),
        odometry=trajectories["odometry"],
        grid=grid,
        steps=steps,
        facts={"seed": seed, "wall_s": 12.3, "peak_rss_mb": 312.0, "result_hash": "0" * 64},
    )
    failure = find_failure(trajectories["estimate"], truth=true, relations=known, steps=steps)
    if failure is not None:
        seen = cell_centres(
            true_map, true_map.occupied & observable_cells(true_map, poses[failure.scan], lidar=LidarView())
        )
        write_failure(folder / "finding.json", failure, transform_points(inverse(poses[failure.scan]), seen))
    (folder / "metrics.json").write_text(json.dumps(metrics, allow_nan=False))


def _relations(stamps: Any, poses: Pose) -> Relations:
    """True motions over 5 s, and between the laps."""
    n = len(stamps)
    first = np.concatenate([np.arange(0, n - 50, 10), np.arange(0, n // 2, 10)])
    second = np.concatenate([np.arange(50, n, 10), np.arange(0, n // 2, 10) + n // 2])
    return Relations(stamps[first], stamps[second], between(poses[first], poses[second]))


def _estimated_map(truth: OccupancyGrid, first: Pose, broken: bool, rng: np.random.Generator) -> OccupancyGrid:
    """The true map as a filter sees it: in the frame of the first pose, noisy; if broken, with a wall twice."""
    p = truth.probability.copy()
    if broken:
        p[20:180, 250:] = np.fmax(p[20:180, 250:], np.roll(p, -7, axis=1)[20:180, 250:] == 1.0)
    noise = rng.beta(1.2, 30.0, p.shape).astype(np.float32)
    p = np.where(p > 0.5, 1.0 - noise, noise + p * 0.0)
    x, y, theta = compose([-first[0], -first[1], 0.0], truth.origin)
    return OccupancyGrid(probability=p, resolution=truth.resolution, origin=(float(x), float(y), float(theta)))


def steps_of(stamps: Any, estimate: Pose, poses: Pose | None, rng: np.random.Generator) -> dict[str, Any]:
    """The table of steps of a run with these stamps (n,), poses (n, 3) and true poses, where known."""
    n = len(stamps)
    updated = np.arange(n) % 5 == 0
    fall = (np.arange(n) // 5) % 24
    ess = np.clip(PARTICLES * np.exp(-fall / 28.0) + rng.normal(0.0, 0.6, n), 1.0, PARTICLES)
    resampled = updated & (fall == 23)
    ancestors = np.maximum(1, PARTICLES - 6 * (np.cumsum(resampled) % 6)).astype(int)
    spread = 0.01 + 0.01 * rng.random(n)
    unknown = np.full(n, np.nan)
    true = {"x": unknown, "y": unknown, "theta": unknown, "error_m": unknown, "error_deg": unknown}
    online = estimate + rng.normal(0.0, [0.01, 0.01, 0.003], (n, 3))
    if poses is not None:
        miss = between(poses, compose(poses[0], online))
        true = {
            "x": poses[:, 0],
            "y": poses[:, 1],
            "theta": poses[:, 2],
            "error_m": np.hypot(miss[:, 0], miss[:, 1]),
            "error_deg": np.degrees(np.abs(miss[:, 2])),
        }
    zero = np.zeros(n)
    return {
        "scan": np.arange(n),
        "stamp": stamps,
        "updated": updated,
        **dict(zip(("x", "y", "theta"), online.T, strict=True)),
        **{"cov_xx": spread**2, "cov_xy": zero, "cov_yy": spread**2, "cov_xt": zero, "cov_yt": zero},
        "cov_tt": (0.3 * spread) ** 2,
        "particles": np.full(n, PARTICLES),
        "ess": ess,
        "resampled": resampled,
        "matched_share": np.clip(0.93 - 0.3 * (np.arange(n) < 60) + rng.normal(0, 0.02, n), 0, 1),
        "match_failures": (rng.random(n) < 0.02).astype(int),
        "log_evidence": rng.normal(-20.0, 3.0, n),
        "unique_ancestors": ancestors,
        "map_bytes": np.linspace(1e6, 9e6, n).astype(int),
        "loop_closed": np.arange(n) == int(0.52 * n / 5) * 5,
        "filter_s": np.where(updated, 0.012, 0.0),
        **{"match_s": np.where(updated, 0.008, 0.0), "sample_s": zero, "map_s": np.where(updated, 0.003, 0.0)},
        "resample_s": np.where(resampled, 0.001, 0.0),
        **{f"true_{name}": true[name] for name in ("x", "y", "theta")},
        "error_m": true["error_m"],
        "error_deg": true["error_deg"],
    }


def _config(seed: int) -> dict[str, Any]:
    return {
        "command": f"testbed run ring --particles {PARTICLES} --seed {seed}",
        "settings": {"world": "ring", "seed": seed, "filter": {"particles": PARTICLES, "map": {"cell": 0.05}}},
        "inputs": {},
        "versions": {"python": "3.11.9", "numpy": "2.4.6"},
        "machine": {"system": "Linux", "processor": "some <processor>", "cores": 2},
    }
