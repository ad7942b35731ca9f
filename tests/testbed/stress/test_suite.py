# SPDX-License-Identifier: MIT
"""The design of the stress suite is balanced, and its perturbations change what they are to change."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from slam import se2
from testbed.frame import Frame
from testbed.stress.suite import PERTURBATIONS, ROBOTS, SEVERITIES, WORLDS, design, perturbed
from tests.testbed.stress.test_perturbations import frames  # noqa: F401  # the fixture


def test_every_pair_of_factors_occurs() -> None:
    cases = design(600)
    assert len({case.name for case in cases}) == 600
    values = {"world": WORLDS, "robot": [r for r, _ in ROBOTS], "perturbation": PERTURBATIONS, "severity": range(3)}
    for a, b in combinations(values, 2):
        pairs = Counter((getattr(case, a), getattr(case, b)) for case in cases)
        assert len(pairs) == len(values[a]) * len(values[b])
        expected = 600 / len(pairs)
        assert min(pairs.values()) > 0.4 * expected


def test_fewer_runs_are_the_first_of_more() -> None:
    assert design(30) == design(600)[:30]


@pytest.mark.parametrize("name", PERTURBATIONS)
def test_each_perturbation_changes_the_frames_and_no_severity_is_like_another(name: str, frames: list[Frame]) -> None:  # noqa: F811
    longer = [_later(frame, k) for k in range(8) for frame in frames]
    seen = []
    for severity in range(len(SEVERITIES)):
        changed = perturbed(longer, name, severity)
        scans = [0.0 if frame.scan is None else float(frame.scan.hit.sum()) for frame in changed]
        seen.append((len(changed), tuple(scans), tuple(np.round([f.odometry for f in changed], 6).ravel())))
    if name != "reach":  # the fixture's walls are 2 m away
        assert len(set(seen)) == 3


def _later(frame: Frame, lap: int) -> Frame:
    """The frame of a later lap of ten seconds, for which the wheels go on counting."""
    odometry = se2.compose((float(lap), 0.5 * lap, 0.1 * lap), frame.odometry)
    return replace(frame, stamp=frame.stamp + 10.0 * lap, odometry=odometry)
