# SPDX-License-Identifier: MIT
"""Readings of a lidar: exact distances with layers of errors, each of which can be switched off.

The layers act in this order: surfaces (short returns, mixed pixels, grazing), then the device (bias, noise, rounding,
lost beams, limits). Their sizes come from the lidar's preset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from testbed.frame_table import BeamPattern
from testbed.presets import LidarPreset, Mount
from testbed.simulation.physics.backend import Hits
from testbed.simulation.robot._lidar_kernels import Optics, read_sweeps
from testbed.simulation.robot.random_rows import RandomRows


@dataclass(frozen=True, kw_only=True)
class LidarLayers:
    """Imperfections that are switched on. A layer whose size in the preset is zero has no effect."""

    motion: bool = True
    """Simulate motion distortion: each beam is measured from its own pose."""
    beam_count: bool = True
    """Vary the number of beams (`beam_jitter`)."""
    angle_noise: bool = True
    """Add errors to the directions of beams (`angle_noise_deg`)."""
    short_returns: bool = True
    """Add readings in front of the surface (`short_return_rate`)."""
    mixed_pixels: bool = True
    """Add readings between two surfaces at edges (`spot_deg`)."""
    grazing: bool = True
    """Lose returns from surfaces at grazing angles (`grazing_deg`)."""
    bias: bool = True
    """Add a constant and a scale error of the device, drawn once per run (`bias_floor`, `bias_share`)."""
    range_noise: bool = True
    """Add a random error to each range (`noise_floor`, `noise_share`)."""
    rounding: bool = True
    """Round ranges to whole steps (`range_step`)."""
    mounting: bool = True
    """Add an error to the mount of the lidar (`Mount.error`, `Mount.error_deg`, `Mount.offset_x`)."""
    dropout: bool = True
    """Lose beams at random (`dropout`)."""

    @classmethod
    def none(cls) -> LidarLayers:
        """Return the layers of a perfect lidar."""
        return cls(**{field.name: False for field in fields(cls)})


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """The beams of one scan, or of several one after the other, before they are cast."""

    patterns: list[BeamPattern]
    """Directions and times that the device reports, of each scan; scans with as many beams share theirs."""
    starts: NDArray[np.int64]
    """First beam of each scan, and the end, (scans + 1,)."""
    angles: NDArray[np.float64]
    """Directions that the device reports, lidar frame [rad], (beams,)."""
    true_angles: NDArray[np.float64]
    """True directions of the beams, lidar frame [rad], (beams,)."""
    time_offsets: NDArray[np.float64] | None
    """Time of each beam after the first of its scan [s], (beams,); None = all at once."""


def optics_of(preset: LidarPreset, layers: LidarLayers) -> Optics:
    """Return the sizes of the imperfections that are on."""
    return Optics(
        spot=math.radians(preset.spot_deg) * layers.mixed_pixels,
        field_of_view=math.radians(preset.field_of_view_deg),
        full_turn=preset.is_full_turn,
        grazing=math.sin(math.radians(preset.grazing_deg)) * layers.grazing,
        short_return_rate=preset.short_return_rate * layers.short_returns,
        noise_floor=preset.noise_floor * layers.range_noise,
        noise_share=preset.noise_share * layers.range_noise,
        range_step=preset.range_step * layers.rounding,
        dropout=preset.dropout * layers.dropout,
        range_min=preset.range_min,
        range_max=preset.range_max,
    )


def draw_device(preset: LidarPreset, mount: Mount, layers: LidarLayers, rng: Generator) -> NDArray[np.float64]:
    """Draw the errors of one device, (5,): constant error [m] and factor of its ranges, true mount x, y [m], theta
    [rad].

    Five numbers are drawn whatever layers are on.
    """
    constant, scale = rng.uniform(-1.0, 1.0, 2) * layers.bias
    error = rng.standard_normal(3) * layers.mounting
    error *= [mount.error, mount.error, math.radians(mount.error_deg)]
    error[0] += mount.offset_x * layers.mounting
    return np.array([preset.bias_floor * constant, 1.0 + preset.bias_share * scale, *(mount.pose + error)])


class Lidar:
    """One lidar with its own random stream; the numbers it draws do not depend on the layers or on what it sees."""

    def __init__(self, preset: LidarPreset, mount: Mount, layers: LidarLayers, rng: Generator) -> None:
        self._preset, self._layers = preset, layers
        self._max_beams = math.ceil(preset.beams * (1.0 + _MAX_JITTER * preset.beam_jitter))
        self._optics = optics_of(preset, layers)
        self._device = draw_device(preset, mount, layers, rng)
        self._patterns: dict[int, BeamPattern] = {}  # by the number of beams
        self._numbers = RandomRows(1, 2 * self._max_beams, 2 * self._max_beams + 1, rows=BEAM_ROWS)
        self._numbers.seed(0, rng)
        self.mount = mount.pose
        """Nominal `T_robot_lidar` (x, y, theta) [m, m, rad]."""
        self.true_mount = self._device[2:]
        """True `T_robot_lidar`, (3,) [m, m, rad]."""

    def sweep(self, scans: int = 1) -> Sweep:
        """Return the beams of the next scan, or of several: at least one and at most `scans`."""
        self._uniform, self._normal = self._numbers.next_of(0, scans)
        counts = self._counts()
        patterns = [self._pattern(count) for count in counts]
        self._starts = np.cumsum([0, *counts], dtype=np.int64)
        angles = np.concatenate([pattern.angles for pattern in patterns])
        true_angles = angles
        if self._layers.angle_noise and self._preset.angle_noise_deg > 0.0:
            noise = [normal[:count] for normal, count in zip(self._normal, counts, strict=True)]
            true_angles = angles + np.concatenate(noise) * math.radians(self._preset.angle_noise_deg)
        offsets = [pattern.time_offsets for pattern in patterns if pattern.time_offsets is not None]
        return Sweep(
            patterns=patterns,
            starts=self._starts,
            angles=angles,
            true_angles=true_angles,
            time_offsets=np.concatenate(offsets) if offsets else None,
        )

    def _counts(self) -> list[int]:
        """Return the number of beams of each scan."""
        preset, scans = self._preset, len(self._normal)
        if not self._layers.beam_count or preset.beam_jitter == 0.0:
            return [preset.beams] * scans
        counts = [round(preset.beams * (1.0 + preset.beam_jitter * x)) for x in self._normal[:, -1].tolist()]
        return [min(max(count, 1), self._max_beams) for count in counts]

    def _pattern(self, count: int) -> BeamPattern:
        """Return directions and times of `count` beams: one object for all scans with as many."""
        if count not in self._patterns:
            angles = self._preset.angles(count)
            times = (angles - angles[0]) / (2.0 * math.pi * self._preset.scan_rate) if self._layers.motion else None
            self._patterns[count] = BeamPattern(angles=angles, time_offsets=times)
        return self._patterns[count]

    def ranges(self, hits: Hits) -> NDArray[np.float64]:
        """Return the readings [m] of the last sweep, (beams,).

        inf = no return, -inf = nearer than `range_min`, NaN = lost, as in ROS REP 117.
        """
        readings: NDArray[np.float64] = read_sweeps(
            hits.distances,
            hits.cos_incidence,
            self._starts,
            self._uniform,
            self._normal,
            self._optics,
            self._device[:2],
        )
        return readings


BEAM_ROWS = 16
"""Number of scans whose random numbers are drawn at once."""
_MAX_JITTER = 4.0
"""Largest deviation of the beam count from the nominal one [standard deviations]."""
