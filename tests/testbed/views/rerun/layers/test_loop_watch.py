# SPDX-License-Identifier: MIT
"""What is said of a loop, when it begins to close and when it has settled."""

from __future__ import annotations

import numpy as np

from slam.step.step_report import StepReport
from testbed.views.rerun.layers.loop_watch import LoopWatch
from tests.testbed.views.synthetic import snapshots


def step(spread: float, loop_length: float = 0.0) -> StepReport:
    """A report of an update with this standard deviation of the position [m]."""
    (first,) = snapshots(0.0, particles=2)
    assert first.step is not None
    return StepReport(
        updated=True,
        pose=np.zeros(3),
        covariance=np.diag([0.5 * spread**2, 0.5 * spread**2, 0.0]),
        particles=2,
        ess=2.0,
        readings=first.step.readings,
        loop_length=loop_length,
    )


def said(loops: dict[int, float], died: dict[int, int], updates: int) -> dict[int, list[str]]:
    """Lines by update, one a second and 0.5 m; loops: length of the loop that closes at an update.

    The spread is 8 cm up to update 95 and 2 cm from then on. The lines of the end come with the number `updates`.
    """
    watch = LoopWatch()
    lines = {
        k: watch.update(float(k), 0.5 * k, step(0.08 if k <= 95 else 0.02, loops.get(k, 0.0)), died.get(k, 0))
        for k in range(updates)
    }
    return {k: texts for k, texts in (lines | {updates: watch.end()}).items() if texts}


def test_a_loop_is_said_at_once_and_again_when_it_has_settled() -> None:
    lines = said({90: 40.0}, died={50: 4, 90: 2, 95: 3, 101: 5}, updates=120)
    assert lines == {
        90: ["loop closes: walls last seen at 10 s, 40 m of driving ago; the particles spread over 8.0 cm"],
        100: ["loop of 40 m closed: 5 particles died, the spread went from 8.0 to 2.0 cm"],
    }


def test_a_loop_ends_with_the_next_one_or_with_the_run() -> None:
    lines = said({93: 20.0, 97: 30.0}, died={97: 1}, updates=99)
    assert [(k, text.split(":")[0]) for k, texts in lines.items() for text in texts] == [
        (93, "loop closes"),
        (97, "loop of 20 m closed"),
        (97, "loop closes"),
        (99, "loop of 30 m closed"),
    ]
    assert lines[97][0].endswith("0 particles died, the spread went from 8.0 to 2.0 cm")
    assert "1 particle died" in lines[99][0]


def test_without_loops_nothing_is_said() -> None:
    assert said({}, died={1: 3}, updates=30) == {}
