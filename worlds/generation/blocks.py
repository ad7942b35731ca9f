# SPDX-License-Identifier: MIT
"""Lay out corridors around rectangular blocks: one block gives a ring, six a grid of three by two."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from numpy.random import Generator
from shapely.geometry.base import BaseGeometry

from worlds.errors import WorldError

CORRIDOR_WIDTH = 2.0
"""Clear width of the corridors [m]."""
MAX_SHIFT = 0.15
"""Inner corridors are shifted at random by up to this share of their distance."""
_MIN_BLOCK = 2.0
"""Shortest side of a block [m]."""
_NICHE_WIDTH, _NICHE_DEPTH = 1.0, 0.15
"""A door that is closed: a recess of this width and depth in the wall [m]."""
_NICHE_SPACING = (3.0, 9.0)
"""Distance between the middles of neighbouring recesses in one wall, uniform [m]."""


class Blocks(NamedTuple):
    """The layout: corridors run along all lines of a lattice, from its first to its last."""

    x: list[float]
    """Centre lines of the corridors that run along y [m], ascending."""
    y: list[float]
    """Centre lines of the corridors that run along x [m], ascending."""
    floor: BaseGeometry
    """Corridors with the recesses of the doors."""


def lay_out_blocks(size: tuple[float, float], blocks: int, rng: Generator) -> Blocks:
    """Lay out corridors around so many blocks within an area of `size` [m], in rows and columns as square as possible.

    The outer loop is `2 * (width + depth) - 8 * CORRIDOR_WIDTH / 2` long along its centre line. The seed decides where
    the inner corridors and the doors are. Raises `WorldError` if the blocks do not fit.
    """
    cols, rows = _most_square(blocks, size)
    x, y = _lines(size[0], cols, rng), _lines(size[1], rows, rng)
    smallest = min(float(np.diff(lines).min()) for lines in (x, y)) - CORRIDOR_WIDTH
    if smallest < _MIN_BLOCK:
        raise WorldError(
            f"{blocks} blocks in {size[0]:g} x {size[1]:g} m would be {max(smallest, 0.0):.1f} m wide, "
            f"expected at least {_MIN_BLOCK:g} m: fewer loops or a larger size"
        )
    half = 0.5 * CORRIDOR_WIDTH
    along_y = [shapely.box(line - half, y[0] - half, line + half, y[-1] + half) for line in x]
    along_x = [shapely.box(x[0] - half, line - half, x[-1] + half, line + half) for line in y]
    niches = [niche for line in x for niche in _niches(line, y, rng)]
    niches += [_transposed(niche) for line in y for niche in _niches(line, x, rng)]
    return Blocks(x, y, shapely.union_all([*along_x, *along_y, *niches]))


def _most_square(blocks: int, size: tuple[float, float]) -> tuple[int, int]:
    """Columns and rows whose product is the number of blocks, and whose blocks are as square as possible."""
    shapes = [(cols, blocks // cols) for cols in range(1, blocks + 1) if blocks % cols == 0]
    if not shapes:
        raise WorldError("loops 0: corridors around blocks have at least one loop")
    return min(shapes, key=lambda shape: abs(math.log((size[0] / shape[0]) / (size[1] / shape[1]))))


def _lines(side: float, blocks: int, rng: Generator) -> list[float]:
    """Centre lines of blocks + 1 corridors within a side [m]; the inner ones are shifted at random."""
    lines = np.linspace(0.5 * CORRIDOR_WIDTH, side - 0.5 * CORRIDOR_WIDTH, blocks + 1)
    shift = MAX_SHIFT * (lines[1] - lines[0])
    lines[1:-1] += rng.uniform(-shift, shift, max(blocks - 1, 0))
    return [float(line) for line in lines.round(3)]


def _niches(line: float, crossings: list[float], rng: Generator) -> list[BaseGeometry]:
    """Recesses in both walls of the corridor along x = line, between its crossings and not at their corners."""
    half = 0.5 * CORRIDOR_WIDTH
    margin = half + _NICHE_WIDTH
    found: list[BaseGeometry] = []
    for low, high in pairwise(crossings):
        for side in (-1.0, 1.0):
            at = low + margin + float(rng.uniform(0.0, _NICHE_SPACING[1] - _NICHE_SPACING[0]))
            while at < high - margin:
                wall = line + side * half
                inside, outside = wall - side * 0.1, wall + side * _NICHE_DEPTH
                found.append(
                    shapely.box(
                        min(inside, outside), at - 0.5 * _NICHE_WIDTH, max(inside, outside), at + 0.5 * _NICHE_WIDTH
                    )
                )
                at += float(rng.uniform(*_NICHE_SPACING))
    return found


def _transposed(shape: BaseGeometry) -> BaseGeometry:
    """The rectangle with x and y exchanged."""
    x_low, y_low, x_high, y_high = shape.bounds
    return shapely.box(y_low, x_low, y_high, x_high)
