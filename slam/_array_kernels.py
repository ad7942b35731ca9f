# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Copies of small arrays for kernels.

numba compiles an assignment of an array to a part of another, such as `out[i] = pose`, together with the message for
shapes that do not fit, written by its whole machinery for strings. A loop compiles to what is needed.
"""

from __future__ import annotations

from slam._jit import inlined


@inlined
def copy_values(source, out):
    """out (n,) = source (n,)."""
    for i in range(out.shape[0]):
        out[i] = source[i]


@inlined
def copy_matrix(source, out):
    """out (n, m) = source (n, m)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]
