# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""What a cell of the maps remembers, as bits of words, in functions of plain numbers.

    counts   bits 9..15 hits | bits 0..8 visits (hits + beams that passed)
    step     bits 16..31 dy | bits 0..15 dx of the way from a cell to the nearest wall, both with a sign
    surface  bits 20..31 mean x | bits 8..19 mean y of the end points, in 1/4096 of a cell | bits 0..7 line direction

The line direction is 0 where the neighbouring walls form no line, else 1 + 255 * angle / pi of the wall's normal.
"""

from __future__ import annotations

import numpy as np

from slam._jit import inlined

HIT_SHIFT = np.uint32(9)
HITS = np.uint32(0x7F)
VISITS = np.uint32(0x1FF)
DIRECTION = np.uint32(0xFF)
NO_WALL = 0
"""Field word of a cell without a wall within the field's radius."""
NO_STEP = np.int32(-(1 << 31))
"""Step of a cell without a wall within the field's radius."""
MEAN_MEMORY = 32
"""The mean of a cell's end points forgets slowly: the gain of a new one never falls below 1 / MEAN_MEMORY."""


@inlined
def packed(cx, cy):
    """One number for a cell."""
    return (np.int64(cy) << 32) | np.int64(cx)


@inlined
def packed_x(number):
    """Column of a packed cell."""
    return number & 0xFFFFFFFF


@inlined
def packed_y(number):
    """Row of a packed cell."""
    return number >> 32


@inlined
def step_x(step):
    """Columns of a step."""
    return np.int32(np.int16(step & 0xFFFF))


@inlined
def step_y(step):
    """Rows of a step."""
    return (step - step_x(step)) >> 16


@inlined
def hits_of(word):
    """Beams that ended in the cell."""
    return (word >> HIT_SHIFT) & HITS


@inlined
def is_full(word):
    """Whether one of the counts is as large as it can be."""
    return ((word & VISITS) == VISITS) | (hits_of(word) == HITS)


@inlined
def halved(word):
    """The counts word with both counts halved."""
    visits, hits = (word & VISITS) >> np.uint32(1), hits_of(word) >> np.uint32(1)
    return (hits << HIT_SHIFT) | visits


@inlined
def counted(word, hit):
    """The counts word after one more beam, a hit (1) or not (0); both counts are halved before either overflows."""
    word = halved(word) if is_full(word) else np.uint32(word)
    return word + (np.uint32(hit) << HIT_SHIFT) + np.uint32(1)


@inlined
def mean_x(surface):
    """Mean end point of a cell from its surface word: x in cells from the cell's corner."""
    return ((surface >> np.uint32(20)) + 0.5) * (1.0 / 4096.0)


@inlined
def mean_y(surface):
    """Mean end point of a cell from its surface word: y in cells from the cell's corner."""
    return (((surface >> np.uint32(8)) & np.uint32(0xFFF)) + 0.5) * (1.0 / 4096.0)


@inlined
def with_end_point(surface, hits, fx, fy):
    """Surface word after the `hits`-th end point at (fx, fy) in [0, 1) cells from the cell's corner."""
    gain = 1.0 / min(float(hits), float(MEAN_MEMORY))
    mx = mean_x(surface) + gain * (fx - mean_x(surface))
    my = mean_y(surface) + gain * (fy - mean_y(surface))
    x, y = np.uint32(min(max(mx, 0.0), 0.9999) * 4096.0), np.uint32(min(max(my, 0.0), 0.9999) * 4096.0)
    return (x << np.uint32(20)) | (y << np.uint32(8)) | (surface & DIRECTION)
