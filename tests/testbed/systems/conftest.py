# SPDX-License-Identifier: MIT
"""The drive of `testbed systems check`, simulated once for all tests that need it, and shortened."""

from __future__ import annotations

from functools import cache

import pytest

from testbed.frame import Frame
from testbed.systems import check

SECONDS = 12.0
"""Length of that part [s]; the whole drive takes longer without telling more about a system."""
_drive = cache(check.drive)


@pytest.fixture(autouse=True)
def one_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check takes the first part of its drive, simulated once: it changes no frame."""

    def drive() -> list[Frame]:
        return [frame for frame in _drive() if frame.stamp < SECONDS]

    monkeypatch.setattr(check, "drive", drive)
