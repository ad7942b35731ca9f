# SPDX-License-Identifier: MIT
"""The testbed in a few lines, for scripts and notebooks: results show themselves (docs/library.md).

import testbed.library as tb
drive = tb.simulate("office", duration=60)
tb.compare([tb.run(MySlam, drive), tb.run("odometry", drive)])
"""

from testbed.library import notebook
from testbed.library.comparison import Comparison, compare
from testbed.library.drive import Drive, perturb, read, simulate
from testbed.library.listing import Check, Systems, check, systems
from testbed.library.reports import Report, stress, sweep
from testbed.library.result import Result, evaluate, run
from testbed.library.shown_run import ShownRun, show

notebook.register()

__all__ = [
    "Check",
    "Comparison",
    "Drive",
    "Report",
    "Result",
    "ShownRun",
    "Systems",
    "check",
    "compare",
    "evaluate",
    "perturb",
    "read",
    "run",
    "show",
    "simulate",
    "stress",
    "sweep",
    "systems",
]
