# SPDX-License-Identifier: MIT
"""What a sweep is asked for, and the cells that follow from it."""
