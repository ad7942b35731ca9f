# SPDX-License-Identifier: MIT
"""One recording of the synthetic room, shared by the tests that look at it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import rerun as rr

from testbed.views import Snapshot, open_view
from tests.testbed.views.synthetic import scene, snapshots

SECONDS = 20.0


@pytest.fixture(scope="session", autouse=True)
def strict_rerun() -> Iterator[None]:
    """Make errors of what is logged, which Rerun would turn into warnings."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@dataclass(frozen=True)
class Recorded:
    """A recording and what it was made of."""

    path: Path
    snapshots: list[Snapshot]


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    path = tmp_path_factory.mktemp("views") / "recording.rrd"
    shown = []
    with open_view(path, scene()) as view:
        for snapshot in snapshots(SECONDS):
            view.show(snapshot)
            shown.append(snapshot)
    return Recorded(path, shown)
