# SPDX-License-Identifier: MIT
"""What the particles did while the largest loop closed."""

from __future__ import annotations

import numpy as np
import pytest

from eval.filter.closing_loop import largest_closing_loop


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
    assert loop.errors == (0.8, 0.1)


def test_scans_that_close_a_loop_much_later_are_another_one() -> None:
    loop = largest_closing_loop(steps({40: 60.0, 54: 30.0, 69: 30.0}, {68: 3}))
    assert loop is not None
    assert (loop.began, loop.end, loop.died, loop.most_died) == (1040.0, 1068.0, 3, 1068.0)


def test_a_loop_in_which_particles_died_comes_before_a_longer_one() -> None:
    table = {40: 60.0, 70: 30.0, 90: 20.0}
    loop = largest_closing_loop(steps(table, {72: 3, 91: 5}))
    assert loop is not None
    assert (loop.metres, loop.died, loop.longer) == (30.0, 3, 60.0)
    for died in ({}, {40: 1, 91: 5}):  # none died in any; some died in the longest
        loop = largest_closing_loop(steps(table, died))
        assert loop is not None
        assert (loop.metres, loop.longer) == (60.0, None)


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
