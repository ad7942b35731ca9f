# SPDX-License-Identifier: MIT
"""A real run, for the pages that describe its files, columns and keys."""

import json
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.cheaper import undrawn
from tests.shell import call


@dataclass(frozen=True)
class FinishedRun:
    """A run directory and its contents."""

    directory: Path
    metrics: dict
    keys: set[str]
    """All keys of `metrics.json`, at any depth."""
    columns: list[str]
    """Columns of `steps.parquet`."""


def keys_of(value) -> set[str]:
    return set(value).union(*map(keys_of, value.values())) if isinstance(value, dict) else set()


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory) -> FinishedRun:
    out = tmp_path_factory.mktemp("docs") / "run"
    options = ("--backend", "fast", "--duration", "8", "--particles", "3")
    with undrawn():
        assert call("run", "loop", *options, "--out", out) == 0
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    return FinishedRun(out, metrics, keys_of(metrics), pq.read_schema(out / "steps.parquet").names)
