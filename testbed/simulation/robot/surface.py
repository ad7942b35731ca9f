# SPDX-License-Identifier: MIT
"""Surfaces that are not as smooth as the walls of a world: what a lidar measures of them depends on place and view.

Shelves, frames, radiators, cloth: a beam as wide as its spot meets several of their depths, and which of them decides
changes with the place and with the direction it comes from, but not with time. Readings of neighbouring beams, and of
scans from nearly the same place, are then off by the same distance, which no averaging takes away. Here this is a
Gaussian random field over place and direction, a sum of random waves (Rahimi and Recht, "Random features for
large-scale kernel machines", NIPS 2007); readings that scatter, each on its own, come on top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from testbed.seeds import Stream, children
from testbed.simulation.physics.backend import Hits
from testbed.simulation.robot._surface_kernels import sum_waves

Floats = NDArray[np.float64]

WAVES = 128
"""Waves of the field; with so many its values are Gaussian to the eye."""
LENGTHS = (0.01, 1.0)
"""Smallest and largest length of the waves along a wall [m]. They are drawn evenly on a logarithmic scale: in recorded
logs the covariance falls about linearly with the logarithm of the distance, to nothing at a metre."""


@dataclass(frozen=True, kw_only=True)
class SurfaceConfig:
    """How rough surfaces are; smooth by default."""

    roughness: float = 0.0
    """Roughness of surfaces: standard deviation of the range error that repeats at the same place and direction [m]."""
    view_deg: float = 12.0
    """Change of direction after which this error is a different one [degrees]; recorded logs show 10 to 15."""
    scatter: float = 0.0
    """Standard deviation of the readings that scatter, each independently [m]."""
    scatter_share: float = 0.0
    """Share of the readings that scatter."""

    def __post_init__(self) -> None:
        for name in ("roughness", "scatter"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"surface.{name} must be 0 or more, got {getattr(self, name):g} m")
        if not 0.0 < self.view_deg < math.inf:
            raise ValueError(f"surface.view_deg must be above 0, got {self.view_deg:g} degrees")
        if not 0.0 <= self.scatter_share <= 1.0:
            raise ValueError(f"surface.scatter_share must be 0 to 1, got {self.scatter_share:g}")


class Surface:
    """The surfaces of one run. All lidars see the same field; readings of each scatter on their own."""

    def __init__(self, config: SurfaceConfig, lidars: int, stream: Stream) -> None:
        """Draw the field. lidars: how many there are."""
        self._config = config
        field, *scatters = children(stream, 1 + lidars)
        rng = np.random.default_rng(field)
        lengths = np.exp(rng.uniform(math.log(LENGTHS[0]), math.log(LENGTHS[1]), WAVES))
        of_place = rng.standard_normal((WAVES, 2)) / lengths[:, None]
        of_direction = rng.standard_normal((WAVES, 2)) / math.radians(config.view_deg)
        self._waves = np.concatenate([of_place, of_direction], axis=1) / (2.0 * math.pi)  # turns, not radians
        self._phases = rng.uniform(0.0, 1.0, WAVES)
        self._scatters = [np.random.default_rng(scatter) for scatter in scatters]

    @property
    def is_smooth(self) -> bool:
        """Whether no reading changes."""
        return self._config.roughness == 0.0 and self._config.scatter * self._config.scatter_share == 0.0

    def over(self, hits: Hits, origins: Floats, directions: Floats, lidar: int) -> Hits:
        """Return the hits of beams from origins (beams, 2) [m] along directions (beams,) [rad], as this lidar has them.

        The result for a beam does not depend on how many are given at once.
        """
        if self.is_smooth:
            return hits
        waves = sum_waves(hits.distances, origins, directions, self._waves, self._phases)
        rough = self._config.roughness * math.sqrt(2.0 / WAVES) * waves
        distances = np.maximum(hits.distances + rough + self._scattered(lidar, len(directions)), 0.0)
        return Hits(distances, hits.cos_incidence)

    def _scattered(self, lidar: int, beams: int) -> Floats:
        """Return by how much each beam of a lidar scatters (beams,) [m]; two numbers are drawn for each."""
        fate, size = self._scatters[lidar].random((beams, 2)).T
        scattered: Floats = np.where(fate < self._config.scatter_share, self._config.scatter * ndtri(size), 0.0)
        return scattered
