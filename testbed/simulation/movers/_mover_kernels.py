# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Intersection of rays with circles and segments that move during a scan."""

import numpy as np

from slam._jit import kernel
from testbed.simulation.physics._ray_kernels import distance_along


@kernel
def _distance_to_circle(circle, x, y, cos, sin):
    """Return the distance [m] from (x, y) along (cos, sin) to the circle (3,) `(x, y, radius)`; inf if the ray misses
    it or begins inside."""
    ax, ay = circle[0] - x, circle[1] - y
    along, across = ax * cos + ay * sin, ax * sin - ay * cos
    inside = circle[2] * circle[2] - across * across
    if inside < 0.0:
        return np.inf
    distance = along - np.sqrt(inside)
    return distance if distance >= 0.0 else np.inf


@kernel
def nearest_mover(circles, segments, positions, origins, directions):
    """Return distances [m] (rays,) to the nearest mover, inf = none, and cosines of the angles of incidence (rays,).

    circles (n, c, 3): `(x, y, radius)` [m] at a constant rate; segments (n, s, 4): `(x0, y0, x1, y1)` [m]; positions
    (rays,): time of each ray, as a fractional index into the n instants
    """
    rays, last = directions.shape[0], circles.shape[0] - 1
    distances, cos_incidence = np.full(rays, np.inf), np.zeros(rays)
    circle, segment = np.empty(3), np.empty(4)
    for i in range(rays):
        cos, sin = np.cos(directions[i]), np.sin(directions[i])
        k = min(max(int(positions[i]), 0), last)
        after, weight = min(k + 1, last), positions[i] - k
        x, y = origins[i, 0], origins[i, 1]
        for c in range(circles.shape[1]):
            for a in range(3):
                circle[a] = circles[k, c, a] + weight * (circles[after, c, a] - circles[k, c, a])
            distance = _distance_to_circle(circle, x, y, cos, sin)
            if distance < distances[i]:
                distances[i] = distance
                across = (circle[0] - x) * sin - (circle[1] - y) * cos
                cos_incidence[i] = np.sqrt(max(1.0 - (across / circle[2]) ** 2, 0.0))
        for s in range(segments.shape[1]):
            for a in range(4):
                segment[a] = segments[k, s, a] + weight * (segments[after, s, a] - segments[k, s, a])
            distance = distance_along(segment, x, y, cos, sin)
            if distance < distances[i]:
                distances[i] = distance
                ex, ey = segment[2] - segment[0], segment[3] - segment[1]
                cos_incidence[i] = abs(cos * ey - sin * ex) / np.sqrt(ex * ex + ey * ey)
    return distances, cos_incidence
