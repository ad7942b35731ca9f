# SPDX-License-Identifier: MIT
"""What is left of the difference between the smallest and the largest count after the final pass, and what it shows."""

from __future__ import annotations

from dataclasses import replace

from eval.sweep.measure import Measure
from eval.sweep.results import SweepTable
from eval.sweep.summary import SweepSummary


def after_the_final_pass(table: SweepTable) -> SweepSummary | None:
    """The same runs judged by what the final pass makes of them, as `--measure refined` does; None without such runs.

    Only the smallest and the largest count are known there, unless the sweep made the pass with all of them.
    """
    key = table.measure.refined_key
    if key is None or len(table.counts) < 2 or not (table.cube("refined") == 1.0).any():
        return None
    return SweepSummary(replace(table, measure=Measure(key)).with_final_pass(), ())
