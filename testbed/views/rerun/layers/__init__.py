# SPDX-License-Identifier: MIT
"""The parts of a recording that have a memory: most of them send only what has changed since."""
