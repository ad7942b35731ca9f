# SPDX-License-Identifier: MIT
"""The stress suite counts the runs that it says it counts, and samples its design without looking."""

from __future__ import annotations

from testbed.stress.suite import design
from tools.measure.stress import lost_share, sample, share, table


def row(outcome: str, survivable: bool = True, severity: int = 0, world: str = "office") -> dict:
    return {"outcome": outcome, "survivable": survivable, "severity": severity, "world": world}


def test_only_runs_that_can_be_survived_are_counted() -> None:
    rows = [row("lost"), row("ok"), row("broken loop"), row("lost", survivable=False)]
    assert lost_share(rows) == "1 of 3 (6% to 79%)"
    assert share(0, 0) == "0 of 0"


def test_the_table_has_a_row_for_each_value_and_one_for_all() -> None:
    lines = table([row("lost", severity=2), row("ok", world="park"), row("lost", survivable=False)], "world")
    *_, office, park, everything = lines.splitlines()
    assert office == "| office | 0 of 0 | 0 of 0 | 1 of 1 (21% to 100%) | 1 of 1 (21% to 100%) | 1 |"
    assert park.startswith("| park | 0 of 1 (0% to 79%) |")
    assert everything.endswith("| 1 of 2 (9% to 91%) | 1 |")


def test_a_sample_is_a_part_of_the_design_and_fewer_are_the_first_of_more() -> None:
    cases = design(600)
    drawn = sample(cases, 60)
    assert len(set(drawn)) == 60
    assert set(drawn) < set(cases)
    assert sample(cases, 20) == drawn[:20]
    assert drawn != cases[:60]
