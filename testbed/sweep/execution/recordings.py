# SPDX-License-Identifier: MIT
"""The input data of cells: one simulated drive or log, shared by all variants and particle counts."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.files.tum import read_tum
from eval.map.grids import grid_from_true_map
from eval.map.lidar_view import LidarView
from eval.scoring import cells_in_sight
from eval.trajectory.relations import Relations, read_relations
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from testbed.datasets.truth import attach_truth
from testbed.frame import Frame
from testbed.inspect import Reading
from testbed.run.execute import lidar_views
from testbed.run.job import RecordedFrames
from testbed.seeds import RunSeeds
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation import SimulationConfig, simulate
from testbed.stress.table import parse_perturbations
from testbed.stress.table import perturb as perturbed
from testbed.sweep.errors import SweepError
from testbed.sweep.execution.drive_features import drive_features
from testbed.sweep.execution.features import Features, features_of
from testbed.sweep.spec.cell import Cell, recording_key
from worlds import World, true_map


class TruthMap(NamedTuple):
    """The true map; None where it is unknown."""

    grid: OccupancyGrid | None
    walls: NDArray[np.float64] | None
    """Exact walls `(x0, y0, x1, y1)` [m], (n, 4)."""
    observable: NDArray[np.bool_] | None
    """The cells that the lidars could see on the drive, (rows, cols)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Frames of a drive or log, with what is known of the truth."""

    source: RecordedFrames
    features: Features = field(default_factory=dict)
    """Features of world, route and sensors; empty for logs."""
    relations: Relations | None = None
    lidars: tuple[LidarView, ...] = ()
    """Views of the lidars on the drive; empty for logs, whose runs find them."""
    truth_map: Callable[[float], TruthMap] = lambda cell: TruthMap(None, None, None)
    """Draws the true map with cells of a given size [m]."""


def recording_of(cell: Cell) -> Recording:
    """Simulate or read the recording of a cell. The last two are kept for further cells of the same drive."""
    key: Any = recording_key(cell)
    return _driven(*key) if "world" in cell.source else _logged(*key)


def forget_recordings() -> None:
    """Drop the recordings that are kept, so that the next one is simulated or read again."""
    for kept in (_driven, _drive, _logged, _log):
        kept.cache_clear()


@lru_cache(maxsize=2)
def _driven(world: str, simulator: SimulatorOptions, seeds: RunSeeds, perturb: str) -> Recording:
    drive = _drive(world, simulator, seeds)
    loaded = drive.world
    frames = perturbed(drive.source.frames, parse_perturbations(perturb), seeds.perturbation)
    source = RecordedFrames(frames, drive.source.ended)
    lidars = lidar_views(frames)
    if not lidars:
        why = f"{perturb} leaves no scan" if perturb else "the drive ends before the first scan"
        raise SweepError(f"{loaded.name}: {why}, expected a longer duration")
    path = _true_path(frames)
    return Recording(
        source=source,
        features={**drive.features, **drive_features(frames, path.poses)},
        lidars=lidars,
        truth_map=_true_map(loaded, drive.config, path, lidars),
    )


class _Drive(NamedTuple):
    """A drive as the simulator gives it."""

    world: World
    config: SimulationConfig
    source: RecordedFrames
    features: Features
    """Those of the world and the sensors."""


@lru_cache(maxsize=2)
def _drive(world: str, simulator: SimulatorOptions, seeds: RunSeeds) -> _Drive:
    loaded, config = simulator.load_world(world, seeds), simulator.simulation(seeds)
    with simulate(loaded, config) as simulation:
        source = RecordedFrames(list(simulation), simulation.ended(simulator.duration))
    return _Drive(loaded, config, source, features_of(loaded, config))


def _true_path(frames: Sequence[Frame]) -> Trajectory:
    """True poses at the scans of a drive."""
    at_scans = [(frame.stamp, frame.truth) for frame in frames if frame.scan is not None and frame.truth is not None]
    stamps, poses = zip(*at_scans, strict=True)
    return Trajectory(np.array(stamps), np.array(poses))


def _true_map(
    world: World, config: SimulationConfig, path: Trajectory, lidars: Sequence[LidarView]
) -> Callable[[float], TruthMap]:
    @lru_cache(maxsize=2)
    def drawn(cell: float) -> TruthMap:
        exact = true_map(world, cell, height=config.robot.lidar_mount.height)
        grid = grid_from_true_map(exact)
        return TruthMap(grid, exact.walls, cells_in_sight(grid, path, lidars))

    return drawn


@lru_cache(maxsize=2)
def _logged(source: str, seeds: RunSeeds | None, perturb: str) -> Recording:
    frames, relations = _log(source)
    if seeds is not None:
        frames = perturbed(frames, parse_perturbations(perturb), seeds.perturbation)
    return Recording(source=RecordedFrames(frames), relations=relations)


@lru_cache(maxsize=2)
def _log(source: str) -> tuple[list[Frame], Relations | None]:
    """The frames of a log, with the truth where it is known, and its relations."""
    log: Mapping[str, Any] = json.loads(source)
    table = Reading.from_settings(log).open(Path(log["log"])).table
    if "truth" in log:
        table = attach_truth(table, read_tum(log["truth"]))
    return table.frames(), read_relations(log["relations"]) if "relations" in log else None
