# SPDX-License-Identifier: MIT
"""The runs of a stress test as a table, and what they say of each system and perturbation."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from eval.files.atomic_write import atomic_write
from eval.report.verdict import OUTCOME_SENTENCES
from eval.survival.threshold import Threshold, ThresholdSearch

UNPERTURBED = "none"
"""Name of the runs on the drives as they are."""
TABLE = "stress.parquet"
NO_RESULT = "failed"
"""Outcome of a run that has no result."""
FAILED = frozenset(name for name, (_, severity) in OUTCOME_SENTENCES.items() if severity == "bad") | {"unjudged"}
"""Outcomes of failed runs: those that count as failed in sweeps, and `unjudged`. The truth is known here, so that there
is nothing to judge only where the estimate holds hardly any pose."""
DESCRIPTIONS = {
    "system": "name of the system",
    "perturbation": f"name of the perturbation; {UNPERTURBED} = the drive as it is",
    "severity": "severity from 0 (harmless) to 1 (hopeless); null for the drive as it is",
    "value": "value of the perturbation in its unit; null for the drive as it is",
    "place": "name of the world or log",
    "seed": "seed of drive, perturbation and system",
    "turn": "how many runs of this system and perturbation came before",
    "outcome": "outcome of metrics.json; failed = no result",
    "reason": "why, in words",
    "key": "hash of everything that decides the result",
}


@dataclass(frozen=True, kw_only=True)
class Run:
    """One run of a system on a perturbed drive; the fields are the columns of `stress.parquet` (`DESCRIPTIONS`)."""

    system: str
    perturbation: str
    severity: float | None
    value: float | None
    place: str
    seed: int
    turn: int
    outcome: str
    reason: str
    key: str

    @property
    def has_failed(self) -> bool:
        """Whether the run failed."""
        return self.outcome in FAILED


@dataclass(frozen=True)
class Scale:
    """The values of a perturbation from harmless to hopeless."""

    unit: str
    summary: str
    value_at: Callable[[float], float]
    """From a severity, 0 to 1, to the value."""

    def text(self, severity: float) -> str:
        """The value at a severity; where it lies beyond all that were tried, on which side."""
        if severity < 0.0:
            return f"before {self.value_at(0.0):.3g}"
        return f"{self.value_at(severity):.3g}" if severity <= 1.0 else f"beyond {self.value_at(1.0):.3g}"


def fail_unperturbed(runs: Sequence[Run]) -> set[str]:
    """Systems that fail on all drives as they are."""
    plain = [run for run in runs if run.perturbation == UNPERTURBED]
    return {run.system for run in plain} - {run.system for run in plain if not run.has_failed}


def thresholds(runs: Sequence[Run]) -> dict[tuple[str, str], Threshold]:
    """Threshold of each system and perturbation, in the order of the runs.

    A system that fails on all drives as they are has none: nothing is left to survive.
    """
    hopeless = fail_unperturbed(runs)
    groups: dict[tuple[str, str], ThresholdSearch] = {}
    for run in runs:
        if run.severity is not None and run.system not in hopeless:
            group = groups.setdefault((run.system, run.perturbation), ThresholdSearch())
            group.add(run.severity, failed=run.has_failed)
    return {key: search.threshold for key, search in groups.items()}


def write_runs(folder: str | os.PathLike[str], runs: Sequence[Run], about: Mapping[str, str]) -> None:
    """Write `stress.parquet`; equal runs give equal bytes. about: facts about all runs, its metadata."""
    kinds = {"severity": pa.float64(), "value": pa.float64(), "seed": pa.int64(), "turn": pa.int64()}
    columns = [
        pa.field(field.name, kinds.get(field.name, pa.string()), metadata={"description": DESCRIPTIONS[field.name]})
        for field in fields(Run)
    ]
    schema = pa.schema(columns, metadata={"stress": json.dumps(dict(about), sort_keys=True)})
    with atomic_write(Path(folder) / TABLE) as temporary:
        pq.write_table(pa.Table.from_pylist([asdict(run) for run in runs], schema=schema), temporary)


def read_runs(folder: str | os.PathLike[str]) -> list[Run]:
    """Read `stress.parquet`. Raises OSError where there is none."""
    return [Run(**row) for row in pq.read_table(Path(folder) / TABLE).to_pylist()]
