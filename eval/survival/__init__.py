# SPDX-License-Identifier: MIT
"""How much of a perturbation a system survives: the severity at which half of the runs fail."""
