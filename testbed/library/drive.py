# SPDX-License-Identifier: MIT
"""A drive, simulated or recorded: what systems see, and the truth that they are scored by."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eval.files.map_server import read_map
from eval.files.true_walls import read_true_walls
from eval.files.tum import read_tum
from eval.report import plots
from eval.report.map_images import draw_map, frame_around
from eval.scoring import Reference
from eval.trajectory.alignment import align
from eval.trajectory.relations import read_relations
from testbed.datasets.truth import attach_truth
from testbed.frame import Frame
from testbed.inspect import AS_STATED
from testbed.library import html
from testbed.seeds import RunSeeds
from testbed.stress.table import perturb as perturbed
from testbed.sweep.execution.recordings import recording_of
from testbed.sweep.execution.system_cells import recorded_of
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import Value, checked
from testbed.systems.execute import Recorded

AnyPath = str | os.PathLike[str]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Drive:
    """Frames of a drive with what is known of the truth; `frames` is a list like any other."""

    name: str
    recorded: Recorded
    """The frames, and the references that systems are scored by."""
    origin: str = ""
    """Name of the drive that this one was made of by `perturb`; else its own."""
    change: str = ""
    """What was done to that drive; empty = nothing."""

    def __post_init__(self) -> None:
        if not self.origin:
            object.__setattr__(self, "origin", self.name)

    @property
    def frames(self) -> list[Frame]:
        """All frames, with the truth where it is known."""
        return list(self.recorded.frames)

    def __repr__(self) -> str:
        """One line: length, scans, what is known."""
        reference, odometry = self.recorded.reference, self.recorded.odometry
        known = [
            word
            for word, there in (
                ("true path", reference.trajectory),
                ("true map", reference.grid),
                ("relations", reference.relations),
            )
            if there is not None
        ]
        metres = 0.0 if odometry is None else float(odometry.distance[-1])
        scans = 0 if odometry is None else len(odometry)
        return f"<Drive {self.name}: {scans} scans over {metres:.1f} m; {', '.join(known) or 'no truth'}>"

    def _repr_html_(self) -> str:
        reference = self.recorded.reference
        curves: list[plots.Series] = []
        if self.recorded.odometry is not None:
            odometry, truth = self.recorded.odometry.poses, reference.trajectory
            if truth is not None:
                odometry = align(odometry[:1], truth.poses[:1], "first_pose").apply(odometry)
            curves.append(("odometry, from the first pose", odometry[:, :2], plots.ODOMETRY))
        if reference.trajectory is not None:
            curves.append(("truth", reference.trajectory.poses[:, :2], plots.TRUTH))
        background = None
        if reference.grid is not None:
            frame = frame_around(reference.grid, np.zeros(3), [], 0.5)
            background = draw_map(reference.grid, frame, np.zeros(3))
        return f"{html.line(repr(self))}{html.picture(plots.paths(curves, background=background))}"


def simulate(
    world: str,
    *,
    seed: int = 0,
    duration: float | None = None,
    settings: Mapping[str, Value] | None = None,
) -> Drive:
    """Drive a simulated robot through a world.

    world: name of the catalogue, TOML file or ROS map; duration: longest time [s], None = the whole tour
    settings: values by dotted name as in sweeps, such as {"lidar": "lds01", "odometry.grade": "poor"}

    Raises ValueError for a world or setting that is not there.
    """
    given = dict(settings or {}) | ({} if duration is None else {"duration": duration})
    values = {name: checked(name, value, recorded=False) for name, value in given.items()}
    name = Path(world).stem if world.endswith((".toml", ".yaml")) else world
    cell = Cell(
        place=name, source={"world": world}, line="", settings=values, particles=1, seed=seed, inputs={}, code=""
    )
    return Drive(name=f"{name}, seed {seed}", recorded=recorded_of(cell, recording_of(cell)))


def read(log: AnyPath, *, relations: AnyPath | None = None, truth: AnyPath | None = None) -> Drive:
    """Read a recorded log or dataset directory; relations and truth: as `testbed slam` takes them."""
    path = Path(log)
    table = AS_STATED.open(path).table
    if truth is not None:
        table = attach_truth(table, read_tum(truth))
    map_file = path / "truth_map.yaml"
    grid = read_map(map_file, inside=True) if map_file.is_file() else None
    reference = Reference(
        relations=None if relations is None else read_relations(relations),
        grid=grid,
        walls=None if grid is None else read_true_walls(path, grid),
    )
    return Drive(name=path.name.split(".")[0], recorded=Recorded.of(table.frames(), 0, reference))


def perturb(drive: Drive, *, seed: int = 0, **values: float) -> Drive:
    """Return the drive with faults, such as `perturb(drive, drop_scans=0.3, askew=5)` (docs/stress.md).

    Raises ValueError for an unknown fault or a value that makes no sense.
    """
    chosen = {name.replace("_", "-"): value for name, value in values.items()}
    frames = perturbed(drive.frames, chosen, RunSeeds.from_seed(seed).perturbation)
    recorded = drive.recorded
    kept = replace(recorded.reference, trajectory=None, lidars=(), observable=None)
    words = [*filter(None, [drive.change]), *(f"{key} {value:g}" for key, value in chosen.items())]
    return Drive(
        name=f"{drive.origin}, {', '.join(words)}",
        recorded=Recorded.of(frames, recorded.seed, kept, recorded.ended),
        origin=drive.origin,
        change=", ".join(words),
    )
