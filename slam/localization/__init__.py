# SPDX-License-Identifier: MIT
"""Localisation in a finished map."""
