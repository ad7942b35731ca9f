# SPDX-License-Identifier: MIT
"""Figures of a sweep: one panel per world or kind of building, one axis for all panels, a colour per line."""
