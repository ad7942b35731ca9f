# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernels of the lidar: origins and directions of beams, and the readings of the device."""

from typing import NamedTuple

import numpy as np

from slam._array_kernels import copy_values
from slam._jit import kernel

_EDGE = 0.1  # neighbouring beams whose ranges differ by more lie on two sides of an edge [m]


class Optics(NamedTuple):
    """Sizes of all imperfections of a lidar; zero where a layer is off."""

    spot: float
    """Width of the beam [rad]."""
    field_of_view: float
    """Field of view [rad]."""
    full_turn: bool
    """Whether the last beam is the neighbour of the first one."""
    grazing: float
    """Surfaces with a smaller cosine of the angle of incidence give no return."""
    short_return_rate: float
    """Rate of readings in front of the surface, per metre of beam [1/m]."""
    noise_floor: float
    """Standard deviation of short ranges [m]."""
    noise_share: float
    """Standard deviation of long ranges, as a share of the range."""
    range_step: float
    """Ranges are whole multiples of this [m]."""
    dropout: float
    """Share of beams that are lost."""
    range_min: float
    """Nearer surfaces give no valid reading [m]."""
    range_max: float
    """Farther surfaces give no return [m]."""


@kernel
def place_beams(poses, positions, mount, angles):
    """Return origins (beams, 2) [m] and directions (beams,) [rad] of the beams in the world's frame.

    poses (n, 3): `T_world_robot` at a constant rate, headings unwrapped; positions (beams,): time of each beam, as a
    fractional index into the poses; mount (3,): `T_robot_lidar`; angles (beams,): directions, lidar frame [rad]

    The lidar moves in a straight line between two poses, which at 240 Hz is exact to a micrometre.
    """
    n, last = angles.shape[0], poses.shape[0] - 1
    first = min(max(int(positions[0]), 0), last)
    lidar = np.empty((last + 1, 3))
    for k in range(first, min(int(positions[n - 1]) + 1, last) + 1):
        cos, sin = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        lidar[k, 0] = poses[k, 0] + cos * mount[0] - sin * mount[1]
        lidar[k, 1] = poses[k, 1] + sin * mount[0] + cos * mount[1]
        lidar[k, 2] = poses[k, 2] + mount[2]
    origins, directions = np.empty((n, 2)), np.empty(n)
    for i in range(n):
        k = min(max(int(positions[i]), 0), last)
        after, weight = min(k + 1, last), positions[i] - k
        origins[i, 0] = lidar[k, 0] + weight * (lidar[after, 0] - lidar[k, 0])
        origins[i, 1] = lidar[k, 1] + weight * (lidar[after, 1] - lidar[k, 1])
        directions[i] = lidar[k, 2] + weight * (lidar[after, 2] - lidar[k, 2]) + angles[i]
    return origins, directions


@kernel
def _with_edge(distances, i, uniform, optics):
    """Return the range of beam i [m], mixed with its neighbour's where the beam meets an edge.

    An edge lies anywhere between two beams with equal probability. A beam meets it if it lies within half a spot; the
    range is then the mean of both surfaces, weighted with their parts of the spot.
    """
    n = distances.shape[0]
    if optics.spot == 0.0 or (i == n - 1 and not optics.full_turn):
        return distances[i]
    near, far = distances[i], distances[i + 1 if i + 1 < n else 0]
    reached = min(0.5 * optics.spot * n / optics.field_of_view, 0.5)
    if uniform >= reached or not (np.isfinite(near) and np.isfinite(far)) or abs(far - near) <= _EDGE:
        return near
    return near + 0.5 * uniform / reached * (far - near)


@kernel
def read_beams(distances, cos_incidence, uniform, normal, optics, device):
    """Return readings [m], (beams,): inf = no return, -inf = too near, NaN = lost (ROS REP 117).

    distances [m], cos_incidence (beams,): hits of the beams; uniform (2, n), normal (n,): random numbers, of which the
    first `beams` are used; device (2,): constant error [m] and factor of all ranges of this lidar

    One uniform number decides the fate of a beam: low values give short returns, high values lost beams.
    """
    n = distances.shape[0]
    readings = np.empty(n)
    for i in range(n):
        reading = _with_edge(distances, i, uniform[0, i], optics)
        if cos_incidence[i] < optics.grazing:
            reading = np.inf
        path, fate = min(reading, distances[i], optics.range_max), uniform[1, i]  # dust lies before what was met
        rate = optics.short_return_rate * path
        if fate < 1.001 * rate:  # 1 - exp(-rate) is not larger; the exponential would take a third of this loop
            short = -np.expm1(-rate)
            if fate < short:
                reading = fate / short * path
        if np.isfinite(reading):
            reading = reading * device[1] + device[0]
            reading += max(optics.noise_floor, optics.noise_share * reading) * normal[i]
            if optics.range_step > 0.0:
                reading = np.round(reading / optics.range_step) * optics.range_step
        if reading >= optics.range_max:
            reading = np.inf
        elif reading < optics.range_min:
            reading = -np.inf
        if fate >= 1.0 - optics.dropout:
            reading = np.nan
        readings[i] = reading
    return readings


@kernel
def read_sweeps(distances, cos_incidence, starts, uniform, normal, optics, device):
    """Return readings [m] of several scans, one after the other, (beams of all,), as `read_beams` gives them.

    starts (scans + 1,): first beam of each scan, and the end; uniform (scans, 2 n), normal (scans, 2 n + 1): random
    numbers, of which the second n normal ones are for ranges
    """
    readings = np.empty(distances.shape[0])
    n = uniform.shape[1] // 2
    for k in range(starts.shape[0] - 1):
        begin, end = starts[k], starts[k + 1]
        scan = read_beams(
            distances[begin:end], cos_incidence[begin:end], uniform[k].reshape(2, n), normal[k, n:-1], optics, device
        )
        copy_values(scan, readings[begin:end])
    return readings
