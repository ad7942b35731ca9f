# SPDX-License-Identifier: MIT
"""Hypothesis strategies for the estimator: poses, weights, segments on the grid."""

import numpy as np
from hypothesis import strategies as st

ANGLES = st.floats(-50.0, 50.0)
COORDINATES = st.floats(-1e3, 1e3)


@st.composite
def poses(draw):
    """A pose (3,), headings beyond a full turn included."""
    return np.array([draw(COORDINATES), draw(COORDINATES), draw(ANGLES)])


@st.composite
def weights(draw, largest=40):
    """Normalised weights (n,) over many orders of magnitude, some of them zero."""
    logs = draw(st.lists(st.floats(-60.0, 0.0), min_size=1, max_size=largest))
    values = np.exp(np.array(logs))
    dead = draw(st.lists(st.booleans(), min_size=len(logs), max_size=len(logs)))
    values[np.array(dead) & (values < values.max())] = 0.0
    return values / values.sum()


@st.composite
def segments(draw, size):
    """A segment (4,) of points in [0, size): general, axis-parallel, or through points of the lattice."""
    anywhere = st.floats(0.0, size, exclude_max=True)
    on_lattice = st.integers(0, size - 1).map(float)
    on_halves = st.integers(0, 2 * size - 1).map(lambda k: 0.5 * k)
    coordinate = draw(st.sampled_from([anywhere, anywhere, on_lattice, on_halves]))
    x0, y0, x1, y1 = (draw(coordinate) for _ in range(4))
    kind = draw(st.sampled_from(["general", "general", "horizontal", "vertical", "diagonal"]))
    if kind == "horizontal":
        y1 = y0
    elif kind == "vertical":
        x1 = x0
    elif kind == "diagonal":
        reach = min(abs(x1 - x0), abs(y1 - y0))
        x1, y1 = x0 + np.copysign(reach, x1 - x0), y0 + np.copysign(reach, y1 - y0)
    return np.clip(np.array([x0, y0, x1, y1]), 0.0, np.nextafter(size, 0.0))
