# SPDX-License-Identifier: MIT
"""The input data of cells: one simulated drive or log, shared by all variants and particle counts."""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from eval.files.tum import read_tum
from eval.map.grids import grid_from_true_map
from eval.trajectory.relations import Relations, read_relations
from slam.occupancy import OccupancyGrid
from testbed.datasets.truth import attach_truth
from testbed.formats import open_log
from testbed.run.job import RecordedFrames
from testbed.seeds import RunSeeds
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation import SimulationConfig, simulate
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import RunSettings
from worlds import World, true_map


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Frames of a drive or log, with what is known of the truth."""

    source: RecordedFrames
    relations: Relations | None = None
    truth_map: Callable[[float], OccupancyGrid | None] = lambda cell: None
    """Draws the true map with cells of a given size [m]; returns None if it is unknown."""


def recording_key(cell: Cell) -> Hashable:
    """What the recording of a cell depends on; cells with equal keys have the same frames."""
    if "world" not in cell.source:
        return json.dumps(cell.source, sort_keys=True)
    return str(cell.source["world"]), RunSettings.of(cell.settings).simulator, cell.seeds


def recording_of(cell: Cell) -> Recording:
    """Simulate or read the recording of a cell. The last two are kept for further cells of the same drive."""
    key = recording_key(cell)
    return _driven(*key) if isinstance(key, tuple) else _logged(str(key))


@lru_cache(maxsize=2)
def _driven(world: str, simulator: SimulatorOptions, seeds: RunSeeds) -> Recording:
    place, config = simulator.load_world(world, seeds), simulator.simulation(seeds)
    with simulate(place, config) as simulation:
        frames = list(simulation)
        source = RecordedFrames(frames, simulation.ended(simulator.duration))
    return Recording(source=source, truth_map=_true_map(place, config))


def _true_map(place: World, config: SimulationConfig) -> Callable[[float], OccupancyGrid]:
    height = config.robot.lidar_mount.height
    return lru_cache(maxsize=2)(lambda cell: grid_from_true_map(true_map(place, cell, height=height)))


@lru_cache(maxsize=2)
def _logged(source: str) -> Recording:
    log: Mapping[str, Any] = json.loads(source)
    frames = open_log(log["log"], laser_offset=log.get("laser_offset"), range_max=log.get("range_max")).frames
    if "truth" in log:
        frames = attach_truth(frames, read_tum(log["truth"]))
    return Recording(
        source=RecordedFrames(frames), relations=read_relations(log["relations"]) if "relations" in log else None
    )
