# SPDX-License-Identifier: MIT
"""Simulator, recorded logs, views and the command line: what wires the estimator (`slam`) to data and measures.

Importing it registers the environments `testbed/Drive-v0` and `testbed/Explore-v0` with gymnasium.
"""

from testbed.envs.registration import register_environments

register_environments()
