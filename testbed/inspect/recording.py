# SPDX-License-Identifier: MIT
"""All that is looked at in a recording."""

from __future__ import annotations

from testbed.formats import Log
from testbed.inspect.finding import Finding
from testbed.inspect.lidars import inspect_lidars
from testbed.inspect.odometry import inspect_odometry
from testbed.inspect.times import inspect_times
from testbed.inspect.truth import inspect_truth
from testbed.inspect.turns import compare_turns
from testbed.large_arrays import forget_pages


def inspect_log(log: Log) -> list[Finding]:
    """Look at a recording: topics, times, lidars, odometry, clocks, and what its reader mended.

    Of the truth is said whether it can be the robot's. Nothing is changed.
    """
    findings = [Finding("format", log.format)]
    findings += [
        Finding(
            f"topic {topic.name}",
            f"{topic.type}, {topic.messages} message{'' if topic.messages == 1 else 's'}",
            "ok" if topic.use else "left out",
            topic.use or "not used",
        )
        for topic in log.topics
    ]
    findings += [Finding("reader", fault, "mended", "mended or noted by the reader") for fault in log.repairs]
    if len(log.table):
        findings += inspect_times(log.table)
        findings += inspect_lidars(log.table)
        findings += inspect_odometry(log.table, compare_turns(log.table))
        forget_pages(log.table.ranges)
    return [*findings, inspect_truth(log.table)]
