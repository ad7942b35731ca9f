# SPDX-License-Identifier: MIT
"""The specification of a sweep, and the cells that follow from it."""
