# SPDX-License-Identifier: MIT
"""Sentences about columns name the estimate, the statistic and the unit."""

import pytest

from testbed.sweep.column_words import described


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("setting.refine", "Setting refine; null = its default."),
        (
            "map_filter.f1_2_cells",
            "F1 score of the occupied cells of the best particle's map within two cells, 0 to 1.",
        ),
        (
            "trajectory.odometry.rpe.5m.rot_max_deg",
            "Largest error of the turn over 5 m of the path by odometry alone [deg].",
        ),
        (
            "relations_filter.loops.trans_mean_m",
            "Mean position error of loop relations in the best particle's path at the end [m].",
        ),
        (
            "outcome_online",
            "Outcome of the pose reported at each scan: ok, drift, broken loop, lost, … (docs/metrics.md).",
        ),
        ("something.new_m", "The key something.new_m of metrics.json (docs/metrics.md)."),
    ],
)
def test_a_name_becomes_a_sentence_with_its_unit(name, words):
    assert described(name) == words
