# SPDX-License-Identifier: MIT
"""What a sweep says before it starts."""

from pathlib import Path

import pytest

from testbed.cli.shared.sweep_announcement import Work, announce
from testbed.cli.shared.sweep_options import Execution
from testbed.sweep.spec.plan import Costs, plan
from testbed.sweep.spec.spec import parse_spec


@pytest.mark.parametrize(
    ("finished", "left", "words"),
    [
        (0, 64, "8 jobs to the first look (8 seeds a world), at most 64 in all: loop"),
        (
            8,
            24,
            "at most 24 in all (8 of 64 are done, 32 are not needed: their world has an answer, hardly a chance of "
            "one, or was given up): loop",
        ),
        (8, 56, "at most 56 in all (8 of 64 are done): loop"),
    ],
)
def test_jobs_that_are_not_needed_are_not_called_done(capsys, finished, left, words):
    """Such as those of a world that was given up."""
    document = {"worlds": ["loop", "apartment"], "particles": [1, 3], "seeds": 16, "until": "decided"}
    spec = parse_spec(document, "x", Path())
    cells = plan(spec, "code", {})[:left]
    work = Work(spec, Costs.of(spec), cells[:8], cells, 8, None, finished)
    announce(work, Execution(scheduler="tcp://x:1"), is_plan=True)
    assert words in capsys.readouterr().out.splitlines()[0]
