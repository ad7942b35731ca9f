# SPDX-License-Identifier: MIT
"""Statistics, tables, figures and the report of a sweep."""
