# SPDX-License-Identifier: MIT
"""Finds how much of each perturbation systems survive, by runs on perturbed drives."""
