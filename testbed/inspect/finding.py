# SPDX-License-Identifier: MIT
"""One line of what was found in a recording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

Verdict = Literal["ok", "mended", "left out", "doubtful"]
"""ok: as expected; mended: the reader repairs it; left out: it is not used; doubtful: it may spoil a map."""


class Finding(NamedTuple):
    """What was found, what to think of it, and what the reader does about it."""

    item: str
    """What was looked at, such as `lidar laser`."""
    found: str
    """What is there, with numbers and units."""
    verdict: Verdict = "ok"
    action: str = "used as it is"
    """What the reader does about it, or what the user can do."""


def notes_of(findings: Iterable[Finding]) -> list[str]:
    """The sentences that belong into the notes of a run: what was mended and what is doubtful."""
    return [
        f"{finding.item}: {finding.found}; {finding.action}"
        for finding in findings
        if finding.verdict in ("mended", "doubtful")
    ]
