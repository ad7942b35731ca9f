# SPDX-License-Identifier: MIT
"""A lidar's readings: noise layers on top of exact distances, each of which can be switched off alone.

Order: what the light meets (short returns, mixed pixels, grazing surfaces), then what the device makes of it (bias,
noise, rounding, lost beams, limits). Sources of the sizes: the lidar's preset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from testbed.presets import LidarPreset
from testbed.simulation.backend import Hits

_EDGE = 0.1
"""Neighbouring beams whose ranges differ by more than this lie on two sides of an edge [m]."""


@dataclass(frozen=True, kw_only=True)
class LidarLayers:
    """Which imperfections are on. A layer whose size in the preset is zero does nothing."""

    motion: bool = True
    """A scan takes time: each beam is measured from where the robot is then."""
    beam_count: bool = True
    """The number of beams varies (`beam_jitter`)."""
    angle_noise: bool = True
    """The directions of beams are inexact (`angle_noise_deg`)."""
    short_returns: bool = True
    """Readings before the surface (`short_return_rate`)."""
    mixed_pixels: bool = True
    """Readings between two surfaces at edges (`spot_deg`)."""
    grazing: bool = True
    """No return from surfaces met at a small angle (`grazing_deg`)."""
    bias: bool = True
    """Constant and scale error of the device, drawn once a run (`bias_floor`, `bias_share`)."""
    range_noise: bool = True
    """Random error of each range (`noise_floor`, `noise_share`)."""
    rounding: bool = True
    """Ranges in whole steps (`range_step`)."""
    dropout: bool = True
    """Beams lost at random (`dropout`)."""

    @classmethod
    def none(cls) -> LidarLayers:
        """A perfect lidar."""
        return cls(**{field.name: False for field in fields(cls)})


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """The beams of one scan before they are cast."""

    angles: NDArray[np.float64]
    """Directions as the device reports them, lidar frame [rad], (beams,)."""
    true_angles: NDArray[np.float64]
    """Directions in which the beams really go, lidar frame [rad], (beams,)."""
    time_offsets: NDArray[np.float64] | None
    """Time of each beam after the first [s], (beams,); None = all at once."""


class Lidar:
    """One lidar with its own random stream; the numbers it draws do not depend on the layers or on what it sees."""

    def __init__(self, preset: LidarPreset, layers: LidarLayers, rng: Generator) -> None:
        self._preset, self._layers, self._rng = preset, layers, rng
        constant, scale = rng.uniform(-1.0, 1.0, 2) * layers.bias
        self._bias, self._scale = preset.bias_floor * constant, 1.0 + preset.bias_share * scale

    def sweep(self) -> Sweep:
        """Beams of the next scan."""
        preset, layers = self._preset, self._layers
        jitter = float(self._rng.standard_normal())
        beams = preset.beams
        if layers.beam_count:
            beams = max(1, round(beams * (1.0 + preset.beam_jitter * jitter)))
        angles = preset.angles(beams)
        noise = self._rng.standard_normal(beams) * math.radians(preset.angle_noise_deg)
        offsets = (angles - angles[0]) / (2.0 * math.pi * preset.scan_rate) if layers.motion else None
        return Sweep(angles=angles, true_angles=angles + noise if layers.angle_noise else angles, time_offsets=offsets)

    def ranges(self, hits: Hits) -> NDArray[np.float64]:
        """Readings [m] for what the beams of a sweep met, (beams,).

        As in ROS REP 117: inf = no return, -inf = nearer than `range_min`, NaN = lost.
        """
        preset, layers = self._preset, self._layers
        n = len(hits.distances)
        uniform = self._rng.random((4, n))
        normal = self._rng.standard_normal(n)

        ranges = hits.distances.copy()
        if layers.mixed_pixels and preset.spot_deg > 0.0:
            ranges = self._mixed(ranges, uniform[0])
        if layers.grazing:
            ranges[hits.incidence < math.radians(preset.grazing_deg)] = np.inf
        if layers.short_returns and preset.short_return_rate > 0.0:
            light_path = np.minimum(ranges, preset.range_max)
            interrupted = uniform[1] < -np.expm1(-preset.short_return_rate * light_path)
            ranges = np.where(interrupted, uniform[2] * light_path, ranges)
        ranges = ranges * self._scale + self._bias
        if layers.range_noise:
            ranges = ranges + np.maximum(preset.noise_floor, preset.noise_share * _finite(ranges)) * normal
        if layers.rounding and preset.range_step > 0.0:
            ranges = np.round(ranges / preset.range_step) * preset.range_step
        ranges[ranges >= preset.range_max] = np.inf
        ranges[ranges < preset.range_min] = -np.inf
        if layers.dropout:
            ranges[uniform[3] < preset.dropout] = np.nan
        return ranges

    def _mixed(self, ranges: NDArray[np.float64], uniform: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ranges (beams,), with some beams at edges pulled to the neighbour's surface.

        An edge lies anywhere between two beams with the same chance; a beam meets it if it lies within half a spot,
        and then reads the mean of both surfaces, weighted with their parts of the spot.
        """
        preset = self._preset
        step = preset.field_of_view_deg / max(len(ranges), 1)
        reached = np.minimum(0.5 * preset.spot_deg / step, 0.5)
        neighbour = np.roll(ranges, -1)
        if preset.field_of_view_deg < 360.0:
            neighbour[-1] = ranges[-1]
        both = np.isfinite(ranges) & np.isfinite(neighbour)
        near, far = np.where(both, ranges, 0.0), np.where(both, neighbour, 0.0)
        share = np.where((np.abs(far - near) > _EDGE) & (uniform < reached), 0.5 * uniform / reached, 0.0)
        mixed: NDArray[np.float64] = np.where(share > 0.0, near + share * (far - near), ranges)
        return mixed


def _finite(ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isfinite(ranges), np.abs(ranges), 0.0)
