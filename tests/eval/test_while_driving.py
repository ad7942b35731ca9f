# SPDX-License-Identifier: MIT
"""Which times of a run its outcome while driving comes from, and how each of them began."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory
from eval.while_driving import Drive, WhileDriving, judge_while_driving
from eval.wording import at_time
from slam.se2 import between, compose
from tests.eval.synthetic_run import drive, steps_of

TRUE = drive()  # two laps of 32 m, 6 cm and 0.1 s from pose to pose; the filter takes in each fifth one
STAMPS = 1000.0 + 0.1 * np.arange(len(TRUE))
SHARES_SUM = 1.0


def off_by(profile: dict[tuple[int, int], tuple[float, float]]) -> NDArray[np.float64]:
    """Offsets [m] of all poses: between two rows they go from one value to another in a straight line."""
    offsets = np.zeros(len(TRUE))
    for (first, end), (low, high) in profile.items():
        offsets[first:end] = np.linspace(low, high, end - first)
    return offsets


def judged(
    offsets: NDArray[np.float64], outcome: str = "broken loop", odometry: Trajectory | None = None, **columns: Any
) -> WhileDriving | None:
    """Judge a pose while driving that is off by so much (n,) [m] across the hall."""
    online = between(TRUE[0], TRUE + np.column_stack([np.zeros_like(offsets), offsets, np.zeros_like(offsets)]))
    steps = steps_of(STAMPS, online, TRUE, np.random.default_rng(0))
    steps |= dict(zip(("x", "y", "theta"), online.T, strict=True))
    miss = between(TRUE, compose(TRUE[0], online))
    steps |= {"error_m": np.hypot(miss[:, 0], miss[:, 1]), "error_deg": np.zeros(len(TRUE))}
    steps |= {"loop_closed": np.zeros(len(TRUE))} | columns
    run = Drive(Trajectory(STAMPS, online), Trajectory(STAMPS, TRUE), steps, odometry)
    return judge_while_driving(outcome, run)


def test_the_time_from_which_most_bad_pairs_come_is_first() -> None:
    """The later time is longer: more pairs of visits do not meet because of it, though its error is smaller."""
    found = judged(off_by({(100, 150): (0.9, 0.9), (700, 900): (0.5, 0.5)}))
    assert found is not None
    late, early = found.stretches
    assert (late.start, early.start) == pytest.approx((1070.0, 1010.0), abs=0.01)
    assert late.end == pytest.approx(1090.0, abs=0.5)
    assert late.share > 0.7
    assert late.share + early.share == pytest.approx(SHARES_SUM)
    assert found.worst is early
    assert found.first is early
    assert found.last is late
    assert found.back_in_words(late, 1000.0).startswith("back for good at 90.")
    assert found.back_in_words(early, 1000.0).startswith("back at 15.")
    assert "do not meet (limit 5" in found.evidence
    assert found.part_in_words(late).endswith(" of the pairs that do not meet")


def test_a_bad_pair_counts_for_the_visit_that_is_off() -> None:
    """The same error in the first lap or in the second one spoils the same pairs, which count for its own time."""
    for first in (100, 633):
        found = judged(off_by({(first, first + 150): (0.5, 0.5)}))
        assert found is not None
        (only,) = found.stretches
        assert only.share == pytest.approx(SHARES_SUM)
        assert only.start == pytest.approx(STAMPS[0] + 0.1 * np.ceil(first / 5) * 5, abs=0.01)


def test_being_back_for_a_short_way_is_not_the_end() -> None:
    for gap, count in ((40, 1), (60, 2)):  # 2.4 m and 3.6 m
        found = judged(off_by({(100, 200): (0.5, 0.5), (200 + gap, 300): (0.5, 0.5)}))
        assert found is not None
        assert len(found.stretches) == count


def test_a_jump_to_another_best_particle_is_named_with_its_direction() -> None:
    moved = np.zeros(len(TRUE))
    moved[[100, 300]] = 0.5
    closed = np.zeros(len(TRUE))
    for loop, words in ((95, " as old walls came into view again"), (60, ""), (105, "")):
        closed[:] = 0.0
        closed[loop] = 1.0
        found = judged(off_by({(100, 300): (0.5, 0.5)}), best_moved_m=moved, loop_closed=closed)
        assert found is not None
        (only,) = found.stretches
        assert only.sudden
        assert only.cause == (
            f"another particle became the best: the reported pose moved by 50\N{NO-BREAK SPACE}cm{words}, away from "
            "the truth (0.0\N{NO-BREAK SPACE}cm to 50\N{NO-BREAK SPACE}cm off)"
        )
        assert only.ended.startswith("another particle became the best (50")


def test_what_grew_little_by_little_has_no_single_fault() -> None:
    found = judged(off_by({(100, 300): (0.0, 0.6), (300, 500): (0.6, 0.0)}))
    assert found is not None
    (only,) = found.stretches
    assert not only.sudden
    assert only.cause.startswith("the error grew little by little, to 3")
    assert only.metres == pytest.approx(0.6, abs=0.01)
    assert only.worst == pytest.approx(1030.0, abs=0.5)


def test_a_jump_before_the_limit_is_where_it_began() -> None:
    """A jump to 20 cm, and a growing error that passes the limit of 30 cm 1.8 m later."""
    found = judged(off_by({(200, 260): (0.2, 0.55), (260, 400): (0.55, 0.55)}))
    assert found is not None
    assert found.stretches[0].start == pytest.approx(1020.0, abs=0.01)


def test_what_was_behind_it_is_counted() -> None:
    wheels = between(TRUE[0], TRUE)
    wheels[50:] = compose(compose(wheels[50], [0.0, 0.0, np.radians(30.0)]), between(wheels[50], wheels[50:]))
    found = judged(off_by({(100, 300): (0.5, 0.5)}), odometry=Trajectory(STAMPS, wheels))
    assert found is not None
    assert found.behind.startswith(
        "the wheels slipped in 1 of the 4 intervals of 3 s before it, and the 30 particles did"
    )
    end = found.stretches[0].end
    assert end is not None
    assert f"at all updates from 10.0 s to {at_time(end - 1000.0)}" in found.behind
    wide = {name: np.full(len(TRUE), 1.0) for name in ("cov_xx", "cov_yy", "cov_tt")}
    found = judged(off_by({(100, 300): (0.5, 0.5)}), **wide)
    assert found is not None
    assert found.behind == ""


def test_a_map_that_was_bent_before_is_behind_it() -> None:
    """Most of the bad pairs come from the second time; the pose was 40 cm off already in the first."""
    found = judged(off_by({(100, 130): (0.4, 0.4), (300, 600): (0.6, 0.6)}))
    assert found is not None
    assert found.stretches[0].start > found.stretches[1].start
    assert found.behind.startswith("the map was bent before, drawn while the pose was up to 40\N{NO-BREAK SPACE}cm off")


def test_a_loss_is_the_moment_of_its_time() -> None:
    """A drift from 10 s on, in which the estimate is thrown away at 20 s, until both end at 30 s."""
    offsets = off_by({(100, 200): (0.45, 0.45), (200, 300): (1.6, 1.6)})
    found = judged(offsets, "lost")
    assert found is not None
    (only,) = found.stretches
    assert (only.start, only.moment) == pytest.approx((1010.0, 1020.0), abs=0.6)
    assert "wrong by more than 0.5 m or 20 degrees" in found.evidence


def test_a_pose_that_never_was_off_has_no_such_time() -> None:
    assert judged(np.zeros(len(TRUE))) is None
