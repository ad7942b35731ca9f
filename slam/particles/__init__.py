# SPDX-License-Identifier: MIT
"""Weights, resampling, ancestry and the number of particles."""
