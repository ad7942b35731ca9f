# SPDX-License-Identifier: MIT
"""What counts as harm done by closing loops."""

from types import SimpleNamespace

import numpy as np
import pytest

from slam import se2
from tools.measure.loop_safety import HARM, are_wrong, is_harmed, loop_errors, table


def run(world="maze", wrong=0, ate=0.004, without=0.004):
    return {
        "world": world,
        "changed": wrong > 0,
        "accepted": 10,
        "accepted_wrong": wrong,
        "rejected": 3,
        "rejected_right": 1,
        "ate_m": ate,
        "ate_without_m": without,
    }


def test_a_loop_errs_by_how_far_its_maps_were_from_where_it_puts_them():
    truth = np.array([(0.0, 0.0, 0.0), (9.0, 9.0, 9.0), (1.0, 2.0, 0.5), (-4.0, 1.0, 3.0)])
    right = se2.between(truth[2], truth[3])
    shift = np.array([0.0, 0.4, -0.02])
    loops = [SimpleNamespace(first=1, second=2, pose=pose) for pose in (right, se2.compose(right, shift))]
    closing = SimpleNamespace(frames=np.array([0, 2, 3]), loops=loops)
    errors = loop_errors(closing, truth)
    np.testing.assert_allclose(errors, [(0.0, 0.0), (0.4, 0.02)], atol=1e-12)
    assert are_wrong(errors).tolist() == [False, True]


@pytest.mark.parametrize("row", [run(wrong=1), run(ate=0.0041 + HARM)])
def test_a_wrong_loop_is_harm_and_so_is_a_path_that_is_worse(row):
    assert is_harmed(row)
    assert not is_harmed(run(ate=0.0039 + HARM))
    assert not is_harmed(run(ate=0.004, without=1.0))


def test_the_table_has_a_line_for_each_world_and_one_for_all():
    lines = table([run(), run("office", wrong=2), run("office", ate=0.02)]).splitlines()
    maze, office, everything = lines[2:]
    assert maze == ("| maze | 1 | 0 | 0 of 10 (0% to 28%) | 3 (1) | +0.0 mm | 0 of 1 (0% to 79%) |")
    assert office.startswith("| office | 2 | 1 | 2 of 20 ")
    assert "| +16.0 mm | 2 of 2 " in office
    assert everything.startswith("| all | 3 | 1 | 2 of 30 ")
