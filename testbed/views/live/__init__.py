# SPDX-License-Identifier: MIT
"""Viewers that run: windows, web pages, and the relay that feeds them."""
