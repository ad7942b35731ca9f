# SPDX-License-Identifier: MIT
"""Simulator, recorded logs, views and the command line, which connect the estimator (`slam`) to data and measures.

Importing it registers the environments `testbed/Drive-v0` and `testbed/Explore-v0` with gymnasium. `testbed.show(run)`
shows a run in a notebook (docs/python.md).
"""

from importlib import import_module
from typing import Any

from testbed.registration import register_environments, when_imported

when_imported("gymnasium", register_environments)


def __getattr__(name: str) -> Any:
    """`show` of the library above, which is imported at its first use, so that a command starts at once."""
    if name == "show":
        return import_module("testbed.library").show
    raise AttributeError(f"module 'testbed' has no attribute {name!r}")
