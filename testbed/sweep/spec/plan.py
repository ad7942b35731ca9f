# SPDX-License-Identifier: MIT
"""Makes the cells of a specification, predicts their work, and divides them into shards."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testbed.formats import open_log
from testbed.seeds import RunSeeds
from testbed.simulation import DriverConfig
from testbed.sweep.errors import SweepError
from testbed.sweep.spec.cell import Cell, recording_key
from testbed.sweep.spec.settings import RunSettings, Value
from testbed.sweep.spec.spec import LogSource, SweepSpec
from testbed.systems.entrant import entrant_of
from testbed.systems.finding import file_of
from worlds import label

_YAML = (".yaml", ".yml")
"""Suffixes of ROS maps; the image of a map is a second file in the same directory."""
_SPEED = DriverConfig().speed
"""Cruising speed [m/s] unless the settings change it."""
_WITHOUT_PARTICLES = 9.0
"""Simulating and scoring take as long as this many particles (measured: mean over the preset `particles`)."""
_FINAL_PASS = 14.0
"""The final pass takes as long as this many particles (measured: office and apartment)."""
_PROPOSAL_COSTS = {"improved": 1.0, "scan-match": 0.75, "motion": 0.85}
"""Time per particle by `filter.proposal.kind`, as a multiple of the first (measured on the same worlds)."""


def file_digest(path: str | Path) -> str:
    """SHA-256 of a file, or of the names and contents of all files in a directory."""
    path = Path(path)
    if not path.is_dir():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    digest = hashlib.sha256()
    for part in sorted(p for p in path.rglob("*") if p.is_file()):
        digest.update(f"{part.relative_to(path).as_posix()}\0{file_digest(part)}\n".encode())
    return digest.hexdigest()


def input_digests(spec: SweepSpec) -> dict[str, str]:
    """Digests of all files that a sweep reads, by path; files in the packages belong to the code version.

    Raises OSError if a file cannot be read.
    """
    paths = {path for log in spec.logs for path in (log.log, log.relations, log.truth) if path is not None}
    for world in spec.worlds:
        for line in spec.lines():
            paths |= {str(path) for path in RunSettings.of(line.settings).simulator.files(world)}
    paths |= {str(file) for line in spec.lines() if (file := file_of(str(line.settings.get("system", "")))) is not None}
    return {path: file_digest(path) for path in sorted(paths)}


def _read_by(source: Mapping[str, Any], settings: Mapping[str, Value], inputs: Mapping[str, str]) -> dict[str, str]:
    """The inputs that a cell reads: files that it names, and the image of a ROS map that it names.

    Only names are compared, so the cells of a sweep are the same on a machine without its input files.
    """
    words = {
        word.strip() for v in (*source.values(), *settings.values()) if isinstance(v, str) for word in v.split(",")
    }
    words |= {str(file) for word in words if (file := file_of(word)) is not None}
    maps = {Path(word).parent for word in words if word.endswith(_YAML)}
    return {path: d for path, d in inputs.items() if path in words or (_is_image(path) and Path(path).parent in maps)}


def _is_image(path: str) -> bool:
    return Path(path).suffix in {".pgm", ".png"}


def plan(spec: SweepSpec, code: str, inputs: Mapping[str, str]) -> list[Cell]:
    """All cells in the order of the tables: by place, line, particle count, seed."""
    lines, drawn = spec.lines(), spec.drawn_worlds
    return [
        Cell(
            place=name,
            source=source,
            line=line.name,
            settings={**line.settings, "refine": spec.refines(line, particles)},
            particles=particles,
            seed=seed,
            inputs=read,
            code=code,
        )
        for name, source in _sources(spec)
        for line in lines
        for read in [_read_by(source, line.settings, inputs)]
        for particles in spec.particles
        for seed in spec.seeds[: spec.drawn_seeds if source.get("world") in drawn else None]
    ]


def _sources(spec: SweepSpec) -> list[tuple[str, dict[str, Any]]]:
    """Name and source of each world or log."""
    sources: list[tuple[str, dict[str, Any]]] = [(label(world), {"world": world}) for world in spec.worlds]
    sources += [(log.name, log.model_dump(exclude_none=True)) for log in spec.logs]
    names = [name for name, _ in sources]
    if len(set(names)) < len(names):
        raise SweepError(f"two worlds or logs have the same name: {', '.join(names)}; expected different file names")
    return sources


@dataclass(frozen=True)
class Costs:
    """Predicted work of cells in relative units; of one seed the longest cells are started first."""

    lengths: Mapping[str, float]
    """Length of each place: of the tour [m], or of the log [scans]."""

    @classmethod
    def of(cls, spec: SweepSpec) -> Costs:
        """Load each world and log once; raises WorldError, PresetError or LogError if that fails.

        Every combination of robot, lidar and backend is loaded too, and every SLAM system made, so that a misspelt name
        is reported at once.
        """
        for system in dict.fromkeys(str(line.settings.get("system", "")) for line in spec.lines()):
            if system:
                entrant_of(system).facts()
        lengths = {log.name: _log_length(log) for log in spec.logs}
        for world in spec.worlds:
            for line in spec.lines():
                simulator = RunSettings.of(line.settings).simulator
                seeds = RunSeeds.from_seed(0)
                simulator.simulation(seeds)
                if (name := label(world)) not in lengths:
                    way = simulator.load_world(world, seeds).path()
                    lengths[name] = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
        return cls(lengths)

    def __call__(self, cell: Cell) -> float:
        """Predicted work of one cell."""
        final_pass = _FINAL_PASS if cell.settings.get("refine", True) else 0.0
        return self.length(cell) * (_WITHOUT_PARTICLES + self.filter_work(cell) + final_pass)

    def length(self, cell: Cell) -> float:
        """Length of the drive [m], no longer than the setting `duration` allows, or of the log [scans]."""
        whole = self.lengths[cell.place]
        if "world" not in cell.source or "duration" not in cell.settings:
            return whole
        return min(whole, float(cell.settings["duration"]) * float(cell.settings.get("driver.speed", _SPEED)))

    @staticmethod
    def filter_work(cell: Cell) -> float:
        """How many particles of the usual proposal cost as much as those of the cell."""
        return cell.particles * _PROPOSAL_COSTS.get(str(cell.settings.get("filter.proposal.kind", "improved")), 1.0)


def _log_length(log: LogSource) -> float:
    return float(open_log(log.log, laser_offset=log.laser_offset, range_max=log.range_max).scan_count)


def seed_by_seed(cells: Sequence[Cell], costs: Costs) -> list[Cell]:
    """Sort cells by seed, so that a sweep that is stopped has about as many seeds of each world.

    Within a seed those with the largest predicted work come first; cells of equal work keep their order.
    """
    rank = {seed: number for number, seed in enumerate(sorted({cell.seed for cell in cells}))}
    return sorted(cells, key=lambda cell: (rank[cell.seed], -costs(cell)))


def by_recording(cells: Sequence[Cell]) -> list[list[Cell]]:
    """The cells of each recording, in the order of its first cell; within a recording they keep their order."""
    groups: dict[Hashable, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(recording_key(cell), []).append(cell)
    return list(groups.values())


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count` of a sweep, counted from 0."""

    index: int
    count: int

    def __post_init__(self) -> None:
        if self.count < 1 or not 0 <= self.index < self.count:
            raise SweepError(f"shard {self}: expected 0/{self.count} to {self.count - 1}/{self.count}")

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Parse `i/n`; raises SweepError for other text."""
        index, slash, count = text.partition("/")
        if not (slash and index.isdecimal() and count.isdecimal() and int(count) > 0):
            raise SweepError(f"shard {text!r}: expected i/n such as 0/8")
        return cls(int(index), int(count))

    def of(self, cells: Sequence[Cell], costs: Costs) -> list[Cell]:
        """This shard's cells, in their order.

        Cells of one recording are put next to each other, and the row is cut where the predicted work of the shards is
        equal. So each recording is simulated once, and those at the cuts twice.
        """
        row = [cell for group in by_recording(cells) for cell in group]
        work = np.maximum([costs(cell) for cell in row], 1e-9)
        middle = np.cumsum(work) - 0.5 * work
        shard_of = np.floor(self.count * middle / work.sum())
        own = {cell.key for cell, shard in zip(row, shard_of, strict=True) if shard == self.index}
        return [cell for cell in cells if cell.key in own]
