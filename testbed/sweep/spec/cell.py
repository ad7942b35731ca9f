# SPDX-License-Identifier: MIT
"""One run of a sweep (texts for people call it a job): the data that decide its result, and their hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Hashable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from testbed.seeds import RunSeeds
from testbed.sweep.spec.settings import RunSettings, Value


@dataclass(frozen=True, kw_only=True)
class Cell:
    """The input of one run. Equal cells give equal results on all machines of one kind."""

    place: str
    """Name of the world or log in tables."""
    source: Mapping[str, Any]
    """`{"world": name or path}`, or the fields of a `LogSource`."""
    line: str
    """Name of the combination of settings."""
    settings: Mapping[str, Value]
    """Values by dotted name; the other settings have their defaults."""
    particles: int
    seed: int
    inputs: Mapping[str, str]
    """SHA-256 of the files that the cell reads, by path."""
    code: str
    """`code_version` of the installation that computes it."""

    @property
    def seeds(self) -> RunSeeds:
        """The streams of random numbers that the run draws from."""
        return RunSeeds.from_seed(self.seed)

    @property
    def key(self) -> str:
        """Hash of everything that decides the result, 20 hex digits. Files count by content, not by name or path."""
        content = {
            "source": self._by_content(self.source),
            "settings": self._by_content(self.settings),
            "particles": self.particles,
            "seed": self.seed,
            "inputs": sorted(self.inputs.values()),
            "code": self.code,
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:20]

    def _by_content(self, table: Mapping[str, Any]) -> dict[str, Any]:
        return {k: self._content_of(v) if isinstance(v, str) else v for k, v in table.items() if v is not None}

    def _content_of(self, text: str) -> str:
        """The digest of the file that a text names, alone or as `FILE.py:CLASS`; other texts as they are."""
        file, colon, name = text.rpartition(":")
        return f"{self.inputs[file]}:{name}" if colon and file in self.inputs else self.inputs.get(text, text)

    def document(self) -> dict[str, Any]:
        """The cell as plain data for JSON; `Cell(**document)` restores it."""
        return asdict(self)

    def __str__(self) -> str:
        particles = "1 particle" if self.particles == 1 else f"{self.particles} particles"
        return f"{self.place}, {self.line}, {particles}, seed {self.seed}"


def recording_key(cell: Cell) -> tuple[Hashable, ...]:
    """What the recording of a cell depends on; cells with equal keys have the same frames."""
    settings = RunSettings.of(cell.settings)
    if "world" in cell.source:
        return str(cell.source["world"]), settings.simulator, cell.seeds, settings.perturb
    drawn = cell.seeds if settings.perturb else None  # a log is the same for each seed
    return json.dumps(cell.source, sort_keys=True), drawn, settings.perturb
