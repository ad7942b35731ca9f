# SPDX-License-Identifier: MIT
"""What makes many tests cheaper: reports that are not drawn, cells of sweeps that need no process, fewer examples.

Laws are tried on 50 examples unless a test says otherwise; `make nightly` tries 1000 (`--hypothesis-profile deep`).
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

# Before numpy is loaded: the threads of its linear algebra wait in a busy loop, which makes tests with many small
# systems of equations a quarter dearer, and takes that time from the tests of the other worker.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from tests.cheaper import computed_here, undrawn

settings.register_profile("fast", max_examples=50, deadline=None)  # no test asserts a time
settings.register_profile("deep", max_examples=1000, deadline=None)
settings.load_profile("fast")


def pytest_collection_finish() -> None:
    """Leave modules and tests out of garbage collection, which would look through all of them again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def without_pictures() -> Iterator[None]:
    """Reports have no pictures: to draw them takes most of the time of a short run."""
    with undrawn():
        yield


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sweeps compute their cells here, one after the other, instead of in worker processes."""
    monkeypatch.setattr("testbed.cli.shared.sweep_options.run_locally", computed_here)
