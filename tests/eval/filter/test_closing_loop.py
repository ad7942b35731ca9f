# SPDX-License-Identifier: MIT
"""What the particles did while the largest loop closed."""

from __future__ import annotations

import numpy as np
import pytest

from eval.filter.closing_loop import deaths_in_words, largest_closing_loop, longer_in_words


def steps(loops: dict[int, float], died: dict[int, int], particles: int = 10) -> dict[str, np.ndarray]:
    """A table of 100 scans, one a second, of which the odd ones were not used; what happens by second."""
    seconds = np.repeat(np.arange(100.0), 2)
    used = np.arange(200) % 2 == 0
    table = {
        "stamp": 1000.0 + seconds + 0.5 * ~used,
        "updated": used,
        "particles": np.full(200, particles),
        "loop_length": np.zeros(200),
        "particles_died": np.zeros(200, int),
        "spread_m": np.where(used, 0.01 + np.abs(seconds - 45.0) / 100.0, np.nan),
        "error_m": np.where(seconds < 45, 0.8, 0.1),
    }
    for name, values in (("loop_length", loops), ("particles_died", died)):
        for second, value in values.items():
            table[name][2 * second] = value
    return table


def test_a_loop_goes_from_its_first_scan_until_the_particles_have_settled() -> None:
    loop = largest_closing_loop(steps({10: 25.0, 40: 30.0, 50: 60.0}, {12: 9, 41: 3, 60: 4, 64: 1, 65: 7}))
    assert loop is not None
    assert (loop.metres, loop.began, loop.stamp, loop.end) == (60.0, 1040.0, 1050.0, 1064.0)
    assert (loop.died, loop.resamplings, loop.most_died) == (8, 3, 1060.0)
    assert loop.spread == pytest.approx(0.06)
    assert loop.least_spread == pytest.approx((0.01, 1045.0))
    assert (loop.to_watch, loop.settled) == (1060.0, 1060.0)
    assert loop.errors == (0.8, 0.1)


def test_a_jump_after_the_last_scan_of_a_loop_has_its_own_errors() -> None:
    table = steps({40: 30.0}, {})
    moved, error = np.zeros(200), np.where(np.repeat(np.arange(100), 2) < 43, 0.26, 0.5)
    moved[2 * 43] = 0.28
    loop = largest_closing_loop(table | {"best_moved_m": moved, "error_m": error})
    assert loop is not None
    assert (loop.errors, loop.jump_errors) == ((0.26, 0.5), (0.26, 0.5))


def test_scans_that_close_a_loop_much_later_are_another_one() -> None:
    loop = largest_closing_loop(steps({40: 60.0, 54: 30.0, 69: 30.0}, {68: 3, 70: 5}))
    assert loop is not None
    assert (loop.began, loop.end, loop.died, loop.most_died) == (1040.0, 1068.0, 3, 1068.0)


def with_spread(fall: dict[int, float]) -> dict[str, np.ndarray]:
    """Loops of 60, 30 and 20 m at 40, 70 and 90 s; the spread is 5 cm, and in the loops at these times less by so much
    [m]. The best particle changes at 71 s, and the pose moves by 28 cm."""
    table = steps({40: 60.0, 70: 30.0, 90: 20.0}, {42: 3})
    spread, moved = np.full(200, 0.05), np.zeros(200)
    for second, less in fall.items():
        spread[2 * second + 4 : 2 * second + 20] -= less
    moved[[2 * 71, 2 * 95]] = 0.28, 0.02
    return table | {"spread_m": spread, "best_moved_m": moved}


def test_a_loop_that_decides_comes_before_a_longer_one() -> None:
    loop = largest_closing_loop(with_spread({40: 0.009, 70: 0.011, 90: 0.04}))
    assert loop is not None
    assert (loop.metres, loop.died, [other.metres for other in loop.longer]) == (30.0, 0, [60.0])
    assert loop.jump == (0.28, 1071.0)
    assert loop.jump_errors == (0.1, 0.1)
    assert loop.to_watch == 1071.0
    assert deaths_in_words(loop) == (
        "no particle died, and another became the best: the reported pose moved by 28\N{NO-BREAK SPACE}cm"
    )
    for fall in ({}, {40: 0.02, 90: 0.04}):  # none decides; the longest does
        loop = largest_closing_loop(with_spread(fall))
        assert loop is not None
        assert (loop.metres, loop.longer, loop.jump) == (60.0, (), None)
        assert deaths_in_words(loop) == "3 of 10 particles died"


def test_of_longer_loops_those_are_named_in_which_particles_died() -> None:
    """30 m decide. In 70 m at 10 s and 60 m at 25 s nobody dies, in 50 m at 40 s three do; the spread stays."""
    table = steps({10: 70.0, 25: 60.0, 40: 50.0, 70: 30.0}, {41: 2, 43: 1})
    spread = np.full(200, 0.05)
    spread[2 * 73 : 2 * 90] = 0.02
    loop = largest_closing_loop(table | {"spread_m": spread})
    assert loop is not None
    assert loop.metres == 30.0
    assert [other.metres for other in loop.longer] == [70.0, 60.0, 50.0]
    assert longer_in_words(loop, 1000.0).replace("\N{NO-BREAK SPACE}", " ") == (
        "in longer loops the particles' spread fell by less than 1 cm: 70 m at 10.0 s; 50 m at 41.0 s, where "
        "2 of 10 particles died (3 in all 2 resamplings of the loop); and 1 more"
    )


def test_how_far_the_pose_moved_is_not_said_again() -> None:
    loop = largest_closing_loop(with_spread({70: 0.04}))
    assert loop is not None
    assert deaths_in_words(loop, told=1071.0) == "no particle died, and another became the best"
    assert deaths_in_words(loop, told=1070.0) == deaths_in_words(loop)


def test_deaths_of_several_resamplings_are_no_deaths_of_one() -> None:
    loop = largest_closing_loop(steps({40: 60.0}, {41: 2, 50: 2}))
    assert loop is not None
    assert deaths_in_words(loop) == "2 of 10 particles died (4 in all 2 resamplings of the loop)"


def test_without_loops_or_with_an_old_table_there_is_none() -> None:
    assert largest_closing_loop(steps({}, {})) is None
    old = {name: values for name, values in steps({40: 60.0}, {}).items() if name != "loop_length"}
    assert largest_closing_loop(old) is None
    old = {
        name: v for name, v in steps({40: 60.0}, {}).items() if name not in ("particles_died", "spread_m", "error_m")
    }
    loop = largest_closing_loop(old)
    assert loop is not None
    assert (loop.died, loop.spread, loop.errors) == (None, None, None)


def test_a_single_particle_has_no_spread() -> None:
    loop = largest_closing_loop(steps({40: 60.0}, {}, particles=1))
    assert loop is not None
    assert (loop.spread, loop.least_spread) == (None, None)
