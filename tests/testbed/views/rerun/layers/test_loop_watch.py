# SPDX-License-Identifier: MIT
"""What is said of a loop, when it begins to close and when it has settled."""

from __future__ import annotations

from dataclasses import replace

from slam.step.step_report import StepReport
from testbed.views.rerun.layers.loop_watch import LoopWatch
from tests.testbed.views.synthetic import snapshots


def step(loop_length: float = 0.0, at_place: bool = False) -> StepReport:
    """A report of an update."""
    (first,) = snapshots(0.0, particles=2)
    assert first.step is not None
    return replace(first.step, loop_length=loop_length, loop_at_place=at_place, loop_updates=round(2.0 * loop_length))


def said(
    loops: dict[int, StepReport], died: dict[int, int], updates: int, particles: bool = True, lost_from: int = 10_000
) -> dict[int, list[tuple[str, str]]]:
    """Lines by update, one a second and 0.5 m; loops: reports of the updates at which a loop closes.

    The spread is 8 cm up to update 95, 2 cm at update 98, and else 3 cm. The lines of the end come with the number
    `updates`.
    """
    watch, lines, nothing = LoopWatch(), {}, step()
    for k in range(updates):
        spread = (0.08 if k <= 95 else 0.02 if k == 98 else 0.03) if particles else None
        lines[k] = watch.update((float(k), 10 * k), loops.get(k, nothing), died.get(k, 0), 0.0, spread, k >= lost_from)
    lines[updates] = watch.end(updates >= lost_from)
    return {k: [(line.level, line.text) for line in found] for k, found in lines.items() if found}


def test_a_loop_is_said_at_once_and_again_when_it_has_settled() -> None:
    lines = said({90: step(40.0)}, died={50: 4, 90: 2, 95: 3, 106: 5}, updates=120)
    assert lines == {
        90: [("INFO", "old walls in view again: last seen at 10 s, 40 m ago; the particles spread 8.0 cm")],
        105: [
            (
                "INFO",
                "loop of 40 m: 3 particles died (5 in all); the spread went from 8.0 cm at 90.0 s to 2.0 cm at 98.0 s",
            )
        ],
    }


def test_a_longer_loop_takes_the_place_of_the_shorter_one() -> None:
    lines = said({90: step(20.0), 102: step(42.0, at_place=True)}, died={91: 1}, updates=130)
    assert [text.split(":")[0] for found in lines.values() for _, text in found] == [
        "old walls in view again",
        "back where it was at 18 s, 42 m ago; the particles spread 3.0 cm",
        "loop of 42 m",
    ]
    assert lines[102] == [("INFO", "back where it was at 18 s, 42 m ago; the particles spread 3.0 cm")]
    assert list(lines) == [90, 102, 117]


def test_a_loop_that_ends_while_lost_is_no_success() -> None:
    lines = said({90: step(40.0)}, died={95: 3}, updates=120, lost_from=100)
    assert lines[105] == [("WARN", "the loop of 40 m has not helped: the estimate is lost")]
    begun = said({90: step(40.0)}, died={}, updates=99, lost_from=80)
    assert begun[90] == [
        ("WARN", "old walls in view again: last seen at 10 s, 40 m ago; the particles spread 8.0 cm, while lost")
    ]
    assert begun[99][0][0] == "WARN"


def test_a_loop_ends_with_the_run() -> None:
    assert list(said({97: step(30.0)}, died={}, updates=99)) == [97, 99]


def test_a_single_particle_has_no_spread() -> None:
    lines = said({90: step(40.0)}, died={}, updates=120, particles=False)
    assert lines == {
        90: [("INFO", "old walls in view again: last seen at 10 s, 40 m ago")],
        105: [("INFO", "loop of 40 m: a single particle cannot correct it")],
    }


def test_a_loop_is_said_at_the_time_by_which_the_report_names_it() -> None:
    """Where most particles died, else where another one became the best, else where the loop has its full length."""
    jumps = {93: 0.04, 96: 0.2, 97: 0.02}
    for died, moved, at in (({92: 1, 95: 3}, jumps, 95), ({}, jumps, 96), ({}, {97: 0.02}, 91)):
        watch, found = LoopWatch(), []
        for k in range(120):
            report = step({90: 30.0, 91: 45.0}.get(k, 0.0))
            found += watch.update((float(k), 10 * k), report, died.get(k, 0), moved.get(k, 0.0), 0.05, lost=False)
        assert [line.at for line in found] == [None, None, (float(at), 10 * at)]


def test_without_loops_nothing_is_said() -> None:
    assert said({}, died={1: 3}, updates=30) == {}
