# SPDX-License-Identifier: MIT
"""The report of one run, and the comparison of several, as HTML pages."""
