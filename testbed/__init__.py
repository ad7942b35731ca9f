# SPDX-License-Identifier: MIT
"""Simulator, recorded logs, views and the command line, which connect the estimator (`slam`) to data and measures.

Importing it registers the environments `testbed/Drive-v0` and `testbed/Explore-v0` with gymnasium.
"""

from testbed.registration import register_environments, when_imported

when_imported("gymnasium", register_environments)
