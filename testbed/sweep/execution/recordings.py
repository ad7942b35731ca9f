# SPDX-License-Identifier: MIT
"""The data that cells are computed from: one drive or log, shared by every variant and particle count."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from eval.files.tum import read_tum
from eval.map.grids import grid_from_true_map
from eval.trajectory.relations import Relations, read_relations
from slam.occupancy import OccupancyGrid
from testbed.datasets.truth import with_truth
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.run.execute import drive_ended
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation import SimulationConfig, simulate
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import RunSettings
from worlds import World, true_map


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Frames, and what is known of the truth."""

    frames: list[Frame]
    ended: str | None = None
    """Why the drive did not end as planned."""
    relations: Relations | None = None
    truth_map: Callable[[float], OccupancyGrid | None] = lambda cell: None
    """The true map in cells of a given size [m]; None where it is unknown."""


def recording_of(cell: Cell) -> Recording:
    """The recording of a cell. The last two are kept: cells of one drive are computed one after the other."""
    if "world" not in cell.source:
        return _logged(json.dumps(cell.source, sort_keys=True))
    return _driven(str(cell.source["world"]), RunSettings.of(cell.settings).simulator, cell.seed)


@lru_cache(maxsize=2)
def _driven(world: str, simulator: SimulatorOptions, seed: int) -> Recording:
    place, config = simulator.place(world), simulator.simulation(seed)
    with simulate(place, config) as simulation:
        frames = list(simulation)
        ended = drive_ended(simulation, simulator.duration)
    return Recording(frames=frames, ended=ended, truth_map=_true_map(place, config))


def _true_map(place: World, config: SimulationConfig) -> Callable[[float], OccupancyGrid]:
    height = config.robot.lidar_mount.height
    return lru_cache(maxsize=2)(lambda cell: grid_from_true_map(true_map(place, cell, height=height)))


@lru_cache(maxsize=2)
def _logged(source: str) -> Recording:
    log: Mapping[str, Any] = json.loads(source)
    frames = open_log(log["log"], laser_offset=log.get("laser_offset"), range_max=log.get("range_max")).frames
    if "truth" in log:
        frames = with_truth(frames, read_tum(log["truth"]))
    return Recording(frames=frames, relations=read_relations(log["relations"]) if "relations" in log else None)
