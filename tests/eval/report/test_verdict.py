# SPDX-License-Identifier: MIT
"""What a report says of a run in words."""

from __future__ import annotations

from eval.files.run_reader import read_run
from eval.report.verdict import verdict
from tests.eval.synthetic_run import write_run


def test_the_verdict_of_a_good_run_names_both_errors(tmp_path):
    found = verdict(read_run(write_run(tmp_path / "good")))
    assert found.severity == "good"
    assert "wheel odometry alone has" in " ".join(found.sentences)
    assert [headline.label for headline in found.headlines][:2] == ["trajectory error", "heading error"]
    assert found.lead.startswith("OK: trajectory error ")
