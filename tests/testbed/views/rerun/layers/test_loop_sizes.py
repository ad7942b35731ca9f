# SPDX-License-Identifier: MIT
"""What is said of a loop that was closed."""

from __future__ import annotations

import numpy as np

from slam.step.step_report import StepReport
from testbed.views.rerun.layers.loop_sizes import LoopSizes
from tests.testbed.views.synthetic import snapshots


def step(spread: float) -> StepReport:
    """A report of an update with this standard deviation of the position [m]."""
    (first,) = snapshots(0.0, particles=2)
    assert first.step is not None
    covariance = np.diag([0.5 * spread**2, 0.5 * spread**2, 0.0])
    return StepReport(
        updated=True, pose=np.zeros(3), covariance=covariance, particles=2, ess=2.0, readings=first.step.readings
    )


def test_a_loop_is_said_with_its_length_its_time_and_what_the_particles_did() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 101)
    path = np.column_stack([5.0 * np.cos(angle), 5.0 * np.sin(angle), angle])
    loops = LoopSizes()
    for k in range(101):
        loops.add(float(k), 0.1 * np.pi * k, step(0.08 if k < 95 else 0.02), died=3 if k == 95 else 0)
    assert loops.sentence(path) == (
        "loop closed: back where the robot was at 0 s, after 31 m; in the last 10 s 3 particles died, and the spread "
        "of the particles went from 8.0 to 2.0 cm"
    )


def test_without_an_old_place_no_length_is_said() -> None:
    loops = LoopSizes()
    for k in range(3):
        loops.add(float(k), 0.1 * k, step(0.01), died=1 if k == 1 else 0)
    sentence = loops.sentence(np.zeros((3, 3)))
    assert "left long ago" in sentence
    assert "1 particle died" in sentence
